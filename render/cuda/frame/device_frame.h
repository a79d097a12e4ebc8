// SPDX-License-Identifier: Apache-2.0
// One image of a store: owns the memory of a frame and launches its kernels.
#pragma once

#include "libl4dcodec/cuda/device.h"
#include "render/cuda/frame/frame.h"
#include "render/cuda/store/scene_store.h"

namespace l4d::render {

// What the last frame counted.
struct FrameStats {
  uint32_t visible, projected, instances;
  bool overflow;  // the frame lacks something: its capacity was too small
  uint32_t required_visible, required_instances;
  // Fails with LIMIT_EXCEEDED if `overflow`.
  Status check_whole() const;
};

struct FrameCapacity {
  int width = 0, height = 0;
  uint32_t visible = 0, instances = 0;
  bool backward = false;  // frames that a backward pass follows
};

class DeviceFrame;

// Frames of one time on several streams share one list of visible slots.
struct SliceSharing {
  // Has the list, of the same store, time and capacity. NULL: the frame makes its own.
  const DeviceFrame* owner = nullptr;
  // Recorded by frames that make the list, awaited by others. NULL: nobody waits.
  cudaEvent_t sliced = nullptr;
};

class DeviceFrame {
 public:
  // Of the calling thread's device, see l4d::cuda::use_device.
  Status create();
  ~DeviceFrame();
  DeviceFrame() = default;
  DeviceFrame(const DeviceFrame&) = delete;
  DeviceFrame& operator=(const DeviceFrame&) = delete;

  // Only grows. Waits for the device if it has to.
  Status reserve(const FrameCapacity& capacity);
  const FrameCapacity& capacity() const { return capacity_; }
  // Reserves what slicing the store needs, so that draw() does not have to. Waits for the device
  // if it has to.
  Status reserve_slices(const SceneStore& store);

  // Launches a frame, without waiting. There must be capacity for its size, and for a backward pass
  // if one follows. `time` in seconds.
  Status draw(const SceneStore& store, double time, const l4d_camera& camera,
              const float* background, bool backward, const ImageTarget& target,
              cudaStream_t stream, const SliceSharing& sharing = {});

  const FrameMemory& memory() const { return memory_; }
  // Of the last frame: its view; splats front to back; instances by tile.
  const FrameInput& input() const { return input_; }
  const uint32_t* order() const { return order_; }
  const uint32_t* values() const { return values_; }

  // Waits for the stream.
  Status stats(cudaStream_t stream, FrameStats* out);
  // Passes of frames are timed from now on, which costs a few microseconds each.
  Status time_passes();
  // Seconds of each pass of the last frame: L4D_RENDER_PASS_*. Waits for it.
  Status pass_seconds(double* out);
  // Pass `pass` begins here, if passes are timed.
  Status mark(int pass, cudaStream_t stream);

 private:
  Status slice(const SceneStore& store, double time, const SliceSharing& sharing,
               cudaStream_t stream);
  void make_input(const SceneStore& store, double time, const l4d_camera& camera,
                  const float* background, bool backward);
  void cut_control(void* base, size_t tiles, const FrameCapacity& capacity);

  FrameCapacity capacity_;
  cuda::DeviceMemory slice_control_, control_, tile_order_, per_visible_[8], per_instance_[5];
  size_t control_bytes_ = 0;
  FrameMemory memory_{};
  cuda::PinnedMemory counts_;

  // What the list of visible slots was made of; revision 0: there is no list.
  const SceneStore* sliced_store_ = nullptr;
  uint64_t sliced_revision_ = 0;
  double sliced_time_ = 0;

  FrameInput input_{};
  const uint32_t* order_ = nullptr;
  const uint32_t* values_ = nullptr;
  static constexpr int kEvents = L4D_RENDER_PASS_COUNT + 1;
  cudaEvent_t events_[kEvents] = {};
  bool timed_ = false;
};

}  // namespace l4d::render
