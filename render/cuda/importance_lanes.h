// SPDX-License-Identifier: Apache-2.0
// Views of importance two at a time: while the device works on one, the other is launched, and
// small kernels of both share the device.
#pragma once

#include "render/cuda/importance.h"
#include "render/cuda/pipeline.h"

namespace l4d::render {

// One view, and what it adds to.
struct ImportanceView {
  double time;  // seconds
  l4d_camera camera;
  bool squared;
  uint64_t signs;
  bool seen_only;
  const ImportanceMemory* sums;
};

// The attributes of a scene on the device as a view needs them.
GradientInput gradient_input(const DevicePipeline& pipeline, const l4d_gaussians& gaussians,
                             double time, const l4d_camera& camera);

// After DevicePipeline::render() of the view: adds what it shows, once `after` has passed, which
// may be NULL.
Status launch_view_sums(DevicePipeline* pipeline, const l4d_gaussians& gaussians,
                        const ImportanceView& view, cudaEvent_t after, cudaStream_t stream);

// The room to try a frame of the camera with, where nothing is known of it, and after that one.
FrameRoom first_room(const DevicePipeline& pipeline, const l4d_camera& camera, bool backward);
FrameRoom more_room(FrameRoom room, const FrameFigures& figures);

class ImportanceLanes {
 public:
  // Views of the scene that `scene` holds and `gaussians`, device arrays, describes: both stay as
  // they are as long as there are lanes.
  Status create(const DevicePipeline& scene, const l4d_gaussians& gaussians);
  ImportanceLanes() = default;
  ~ImportanceLanes();
  ImportanceLanes(const ImportanceLanes&) = delete;
  ImportanceLanes& operator=(const ImportanceLanes&) = delete;

  // Launches a view, and waits for the one before the last. Views add to sums in their order.
  Status add(const ImportanceView& view);
  // Waits for all views.
  Status finish();

 private:
  static constexpr size_t kLanes = 2;
  struct Lane {
    DevicePipeline pipeline;
    cudaStream_t stream = nullptr;
    cudaEvent_t added = nullptr;
    ImportanceView view{};
    FrameRoom room;
    bool busy = false;
  };
  Status launch(size_t which);
  Status finish(size_t which);

  l4d_gaussians gaussians_{};
  Lane lanes_[kLanes];
  size_t turn_ = 0;
};

}  // namespace l4d::render
