// SPDX-License-Identifier: Apache-2.0
// The Gaussians of a scene in device memory, made ready for slicing. Frames (device_frame.h) read
// a store; several frames may read one at a time.
#pragma once

#include <optional>

#include "libl4dcodec/cuda/device.h"
#include "render/cuda/store/store.h"

namespace l4d::render {

struct StoreShape {
  size_t slots = 0;  // rounded up to whole chunks if `chunk_clocks`
  Sequence sequence{};
  bool external_sh = false;  // in an array of the caller: set_external_sh()
  uint32_t sh_degree = 0;    // of the store's own
  bool half_sh = false;      // of the store's own: binary16
  // Each chunk of kChunkSlots slots has a clock of its own (ResidentGaussians::origin), and a
  // store that is reserved again keeps what it has.
  bool chunk_clocks = false;
  // What the frames of flat windows are frames of; absent: no slot has a window, or memory for one.
  std::optional<l4d_timeline> windows;
};

// Slots for all Gaussians of a scene; what they hold of SH is up to the caller.
inline StoreShape shape_of(const l4d_gaussians& gaussians, const l4d_timeline& timeline) {
  StoreShape shape;
  shape.slots = static_cast<size_t>(gaussians.count);
  shape.sequence = sequence_of(timeline);
  if (gaussians.window != nullptr) shape.windows = timeline;
  return shape;
}

class SceneStore {
 public:
  SceneStore() = default;
  SceneStore(const SceneStore&) = delete;
  SceneStore& operator=(const SceneStore&) = delete;

  // Reserves memory of the calling thread's device and waits for the device. Unless
  // shape.chunk_clocks, the slots are lost. Fails with LIMIT_EXCEEDED above 2^30 - 1 slots.
  Status reserve(const StoreShape& shape);
  // sh: [slots, stride] binary32 in device memory; frames show it up to `degree`.
  void set_external_sh(const float* sh, uint32_t stride, uint32_t degree);

  // Fills the store with a whole scene from device arrays, sorted by motion. Waits for the device.
  Status store_scene(const l4d_gaussians& gaussians);
  // Slots were written through resident(): slices of them are out of date.
  void touch() { ++revision_; }

  // The slots that frames show: batches, or chunks from pinned memory that stays as it is until the
  // stream has passed.
  Status set_batches(const Batch* batches, uint32_t count, cudaStream_t stream);
  Status set_chunks(const Chunk* chunks, uint32_t count, cudaStream_t stream);

  size_t slots() const { return slots_; }
  size_t slot_bytes() const;
  const ResidentGaussians& resident() const { return resident_; }
  const Sequence& sequence() const { return shape_.sequence; }
  // The frame that `time`, in seconds, belongs to; 0 if no slot has a window.
  uint32_t frame_at(double time) const {
    return shape_.windows.has_value() ? frame_of_time(*shape_.windows, time) : 0;
  }
  uint32_t sh_degree() const { return shape_.sh_degree; }
  bool half_sh() const { return shape_.half_sh; }
  const Chunk* chunks() const { return chunks_.as<Chunk>(); }
  uint32_t num_chunks() const { return num_chunks_; }
  size_t max_chunks() const { return chunks_.size() / sizeof(Chunk); }
  // Another number after each change of what slices depend on.
  uint64_t revision() const { return revision_; }

 private:
  size_t slot_sh_bytes() const;
  size_t slot_window_bytes() const { return shape_.windows.has_value() ? sizeof(FrameWindow) : 0; }
  Status make_slots(size_t slots);

  StoreShape shape_;
  size_t slots_ = 0;
  uint32_t num_chunks_ = 0;
  uint64_t revision_ = 1;
  cuda::DeviceMemory columns_[8], origins_, chunks_;
  ResidentGaussians resident_{};
};

}  // namespace l4d::render
