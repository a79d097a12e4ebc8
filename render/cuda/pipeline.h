// SPDX-License-Identifier: Apache-2.0
// The scene on a device, and frames of it: owns the memory and launches the kernels.
#pragma once

#include <vector>

#include "libl4dcodec/cuda/device.h"
#include "render/cuda/gradient.h"

namespace l4d::render {

// What was counted in the last frame.
struct FrameFigures {
  uint32_t visible, projected, instances;
  bool overflow;     // the frame lacks something: there was not room for all
  uint32_t wanted_visible, wanted_instances;
};

// What a frame needs beside the scene.
struct FrameRoom {
  int width = 0, height = 0;
  uint32_t visible = 0, instances = 0;
  bool backward = false;
};

class DevicePipeline {
 public:
  // Of the calling thread's device, see l4d::cuda::use_device.
  Status create();
  ~DevicePipeline();
  DevicePipeline() = default;
  DevicePipeline(const DevicePipeline&) = delete;
  DevicePipeline& operator=(const DevicePipeline&) = delete;

  // Room for rows of a scene; what is there is lost. Waits for the device.
  Status reserve_rows(size_t rows, uint32_t sh_degree, bool half_sh, const Sequence& sequence);
  // Fills rows [first, first + gaussians.count) from device arrays.
  Status store(const l4d_gaussians& gaussians, uint32_t first, uint32_t first_id,
               cudaStream_t stream);
  // A whole scene from device arrays, sorted by motion. Waits for the device.
  Status store_scene(const l4d_gaussians& gaussians);
  // The rows that frames show.
  Status set_slabs(const Slab* slabs, uint32_t count, cudaStream_t stream);
  size_t rows() const { return capacity_rows_; }
  const ResidentRows& resident() const { return rows_; }
  const Sequence& sequence() const { return sequence_; }

  // Only grows. Waits for the device where it has to.
  Status reserve(const FrameRoom& room);
  const FrameRoom& room() const { return room_; }

  // Launches a frame, without waiting. There must be room for its size, and for the way back if it is
  // wanted. `time` in seconds.
  Status render(double time, const l4d_camera& camera, const float* background, bool backward,
                const ImageTarget& target, cudaStream_t stream);
  // After render() with `backward` of the same view, and an image with its background: sums by splat.
  Status go_back(const BackwardTask& task, cudaStream_t stream);
  // After render(): coverage of each splat, and nothing else.
  Status cover(cudaStream_t stream);

  const FrameMemory& memory() const { return memory_; }
  const BackwardMemory& back_memory() const { return back_; }
  const unsigned long long* coverage() const { return coverage_.as<unsigned long long>(); }
  // [height, width, 3] of room().
  float* scratch_image() const { return image_.as<float>(); }
  // Waits for the stream.
  Status figures(cudaStream_t stream, FrameFigures* out);

  // Stages of frames are timed from now on, which costs a few microseconds each.
  Status time_stages();
  // Of the last frame, in seconds: L4D_RENDER_STAGE_*. Waits for it.
  Status stage_seconds(double* out);

 private:
  Status mark(int event, cudaStream_t stream);

  static constexpr int kEvents = L4D_RENDER_STAGE_COUNT + 1;
  Sequence sequence_{};
  size_t capacity_rows_ = 0;
  uint32_t sh_degree_ = 0;
  bool half_sh_ = false;
  uint32_t num_chunks_ = 0;
  cuda::DeviceMemory row_memory_[7], chunks_, slice_control_;
  ResidentRows rows_{};

  FrameRoom room_;
  cuda::DeviceMemory control_, tile_order_, per_visible_[8], per_instance_[5], image_, back_instances_,
      back_splats_, shown_, coverage_;
  size_t control_bytes_ = 0;
  FrameMemory memory_{};
  BackwardMemory back_{};
  cuda::PinnedMemory counts_;

  // What the last frame was of.
  bool sliced_ = false;
  double sliced_time_ = 0;
  FrameInput input_{};
  const uint32_t* order_ = nullptr;
  const uint32_t* values_ = nullptr;
  cudaEvent_t events_[kEvents] = {};
  bool timed_ = false;
};

}  // namespace l4d::render
