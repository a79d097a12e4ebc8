// SPDX-License-Identifier: Apache-2.0
// Views of importance two at a time: while the device works on one, the other is launched, and
// small kernels of both share the device.
#pragma once

#include "render/cuda/backward/backward_pass.h"
#include "render/cuda/importance/importance.h"

namespace l4d::render {

// One view, and what it adds to.
struct ImportanceView {
  double time;  // seconds
  l4d_camera camera;
  bool squared;
  uint64_t signs;
  bool visibility_only;
  const ImportanceMemory* sums;
};

// After DeviceFrame::draw() of the view: adds what it shows, once `after` has passed, which may be
// NULL.
Status launch_view_sums(const SceneStore& store, const l4d_gaussians& gaussians,
                        const ImportanceView& view, cudaEvent_t after, cudaStream_t stream,
                        DeviceFrame* frame, BackwardPass* back);

// The room to try a frame of the camera with, where nothing is known of it, and after that one.
FrameCapacity first_capacity(const SceneStore& store, const l4d_camera& camera, bool backward);
FrameCapacity more_capacity(FrameCapacity capacity, const FrameStats& stats);

class InFlightViews {
 public:
  // Views of the scene that `store` has and `gaussians`, device arrays, describes: both stay as
  // they are as long as there are views.
  Status create(const SceneStore& store, const l4d_gaussians& gaussians);
  InFlightViews() = default;
  ~InFlightViews();
  InFlightViews(const InFlightViews&) = delete;
  InFlightViews& operator=(const InFlightViews&) = delete;

  // Launches a view, and waits for the one before the last. Views add to sums in their order.
  Status add(const ImportanceView& view);
  // Waits for all views.
  Status finish();

 private:
  static constexpr size_t kInFlight = 2;
  struct InFlight {
    DeviceFrame frame;
    BackwardPass back;
    cudaStream_t stream = nullptr;
    cudaEvent_t added = nullptr;
    ImportanceView view{};
    FrameCapacity capacity;
    bool busy = false;
  };
  Status launch(size_t which);
  Status finish(size_t which);

  const SceneStore* store_ = nullptr;
  l4d_gaussians gaussians_{};
  InFlight views_[kInFlight];
  size_t turn_ = 0;
};

}  // namespace l4d::render
