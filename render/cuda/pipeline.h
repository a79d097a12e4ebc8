// SPDX-License-Identifier: Apache-2.0
// The scene on a device, and frames of it: owns the memory and launches the kernels.
#pragma once

#include <vector>

#include "libl4dcodec/cuda/device.h"
#include "render/cuda/codebooks.h"
#include "render/cuda/gradient.h"

namespace l4d::render {

// What was counted in the last frame.
struct FrameStats {
  uint32_t visible, projected, instances;
  bool overflow;  // the frame lacks something that did not fit
  uint32_t required_visible, required_instances;
  // LIMIT_EXCEEDED where it does.
  Status check_whole() const;
};

// What a frame needs beside the scene.
struct FrameCapacity {
  int width = 0, height = 0;
  uint32_t visible = 0, instances = 0;
  bool backward = false;
};

class DevicePipeline;

// Frames of one time on several streams, of one list of visible slots.
struct SliceSharing {
  // Has the list, of the same slots, time and capacity. NULL: the frame makes its own.
  const DevicePipeline* owner = nullptr;
  // When there is the list: recorded by frames that make it, awaited by others. NULL: nobody waits.
  cudaEvent_t sliced = nullptr;
};

class DevicePipeline {
 public:
  // Of the calling thread's device, see l4d::cuda::use_device.
  Status create();
  ~DevicePipeline();
  DevicePipeline() = default;
  DevicePipeline(const DevicePipeline&) = delete;
  DevicePipeline& operator=(const DevicePipeline&) = delete;

  // Room for slots of a scene; what is there is lost. Waits for the device.
  Status reserve_slots(size_t slots, uint32_t sh_degree, bool half_sh, const Sequence& sequence);
  // SH codebooks for slots of indices, which are lost where there are some. Waits for the device.
  Status set_sh_codebooks(const l4d_codebook* codebooks, uint32_t count, bool half_sh);
  const ShCodebooks& sh_codebooks() const { return codebooks_; }
  // As reserve_slots(), of slots that tell SH by indices.
  Status reserve_indexed_slots(size_t slots, const Sequence& sequence);
  // Room for the escapes of such slots; what is there is lost. Waits for the device.
  Status reserve_escapes(uint64_t escapes);
  // Room for chunks of kChunkSlots slots, each with a clock of its own (origin); of what was there
  // all stays. For stores that are not to be had with reserve_slots(): its slots have one clock.
  // Waits for the device.
  Status reserve_chunks(uint32_t chunks, uint32_t sh_degree, bool half_sh,
                        const Sequence& sequence);
  // As reserve_slots(), of slots that move and whose SH lies elsewhere, see set_live_sh(). Waits
  // for the device.
  Status reserve_live_slots(size_t slots, const Sequence& sequence);
  // sh: [slots, stride] binary32; frames show it up to `degree`.
  void set_live_sh(const float* sh, uint32_t stride, uint32_t degree);
  // Frames of the slots and chunks of another pipeline, which must have them as they are as long as
  // there are frames.
  Status share_slots(const DevicePipeline& owner);
  // Fills slots [first, first + gaussians.count) from device arrays. indices: of slots that tell SH
  // by them, else NULL.
  Status store(const l4d_gaussians& gaussians, const l4d_cuda_sh_indices* indices, uint32_t first,
               uint32_t first_id, cudaStream_t stream);
  // A whole scene from device arrays, sorted by motion. Waits for the device.
  Status store_scene(const l4d_gaussians& gaussians, const l4d_cuda_sh_indices* indices);
  // The slots that frames show.
  Status set_batches(const Batch* batches, uint32_t count, cudaStream_t stream);
  // Or the chunks that frames show, from pinned memory that stays as it is until the stream has
  // passed.
  Status set_chunks(const Chunk* chunks, uint32_t count, cudaStream_t stream);
  size_t slots() const { return capacity_slots_; }
  // Of the store.
  size_t row_bytes() const;
  const ResidentGaussians& resident() const { return slots_; }
  const Sequence& sequence() const { return sequence_; }

  // Only grows. Waits for the device where it has to.
  Status reserve(const FrameCapacity& capacity);
  const FrameCapacity& capacity() const { return capacity_; }

  // Slots have changed: what was sliced is not so any more.
  void forget_slice() { sliced_ = false; }
  // Launches a frame, without waiting. There must be room for its size, and for the backward pass
  // if it is wanted. `time` in seconds.
  Status render(double time, const l4d_camera& camera, const float* background, bool backward,
                const ImageTarget& target, cudaStream_t stream, const SliceSharing& sharing = {});
  // After render() with `backward` of the same view, and an image with its background: sums by
  // splat.
  Status backward(const BackwardTask& task, cudaStream_t stream);
  // After render(): coverage of each splat, and nothing else.
  Status cover(cudaStream_t stream);

  const FrameMemory& memory() const { return memory_; }
  const BackwardMemory& back_memory() const { return back_; }
  const unsigned long long* coverage() const { return coverage_.as<unsigned long long>(); }
  // [height, width, 3] of room().
  float* scratch_image() const { return image_.as<float>(); }
  // Waits for the stream.
  Status stats(cudaStream_t stream, FrameStats* out);

  // Stages of frames are timed from now on, which costs a few microseconds each.
  Status time_passes();
  // Of the last frame, in seconds: L4D_RENDER_PASS_*. Waits for it.
  Status stage_seconds(double* out);

 private:
  Status mark(int event, cudaStream_t stream);
  Status slice(double time, const SliceSharing& sharing, cudaStream_t stream);
  Status make_slots(size_t slots, bool keep);
  Status reserve_slices(size_t chunks);
  size_t row_sh_bytes() const;
  Status take_indices(const l4d_cuda_sh_indices* indices, uint64_t count, ShIndices* out,
                      cudaStream_t stream);
  void launch_store_slots(const l4d_gaussians& gaussians, const ShIndices& indices,
                          const StorePlace& place, cudaStream_t stream);

  static constexpr int kEvents = L4D_RENDER_PASS_COUNT + 1;
  Sequence sequence_{};
  size_t capacity_slots_ = 0;
  uint32_t sh_degree_ = 0;
  bool half_sh_ = false;
  bool sh_elsewhere_ = false;
  uint32_t num_chunks_ = 0;
  const Chunk* chunk_list_ = nullptr;
  cuda::DeviceMemory slot_memory_[7], origins_, chunks_, slice_control_;
  ResidentGaussians slots_{};
  ShCodebooks codebooks_;
  bool half_codebooks_ = false;

  FrameCapacity capacity_;
  cuda::DeviceMemory control_, tile_order_, per_visible_[8], per_instance_[5], image_,
      back_instances_, back_splats_, shown_, coverage_;
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
