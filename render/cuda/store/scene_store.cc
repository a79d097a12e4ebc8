// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/store/scene_store.h"

#include <algorithm>
#include <string>

#include "render/cuda/kernel/launched.h"

namespace l4d::render {
namespace {

// Makes `memory` hold `wanted` bytes and keeps the first `used` of them.
Status grow(size_t wanted, size_t used, cuda::DeviceMemory* memory) {
  if (used == 0 || wanted <= memory->size()) return memory->reserve(wanted);
  cuda::DeviceMemory larger;
  L4D_RETURN_IF_ERROR(larger.reserve(wanted));
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpy(larger.data(), memory->data(), used, cudaMemcpyDeviceToDevice));
  *memory = std::move(larger);
  return {};
}

}  // namespace

size_t SceneStore::slot_sh_bytes() const {
  if (shape_.external_sh) return 0;
  return sh_stride(shape_.sh_degree, shape_.half_sh) *
         (shape_.half_sh ? sizeof(uint16_t) : sizeof(float));
}

size_t SceneStore::slot_bytes() const {
  return sizeof(VisibleInterval) + 4 * sizeof(float4) + sizeof(uint32_t) + slot_window_bytes() +
         slot_sh_bytes();
}

Status SceneStore::reserve(const StoreShape& shape) {
  if (shape.slots > kSlotMask) return Status(L4D_ERR_LIMIT_EXCEEDED, "more than 2^30 - 1 slots");
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  ++revision_;
  shape_ = shape;
  if (!shape.chunk_clocks) slots_ = num_chunks_ = 0;
  return make_slots(shape.slots);
}

// Memory of slots of shape_; the first slots_ of them keep what they have. The device is idle.
Status SceneStore::make_slots(size_t slots) {
  const size_t n = std::max<size_t>(slots, 1);
  const size_t bytes[8] = {sizeof(VisibleInterval), sizeof(float4),     sizeof(float4),
                           sizeof(float4),          sizeof(float4),     slot_sh_bytes(),
                           sizeof(uint32_t),        slot_window_bytes()};
  for (int k = 0; k < 8; ++k) {
    L4D_RETURN_IF_ERROR(grow(n * bytes[k], slots_ * bytes[k], &columns_[k]));
  }
  resident_.interval = columns_[0].as<VisibleInterval>();
  resident_.place = columns_[1].as<float4>();
  resident_.motion = columns_[2].as<float4>();
  resident_.shape0 = columns_[3].as<float4>();
  resident_.shape1 = columns_[4].as<float4>();
  resident_.sh = columns_[5].data();
  resident_.sh_words = static_cast<uint32_t>(slot_sh_bytes() / sizeof(uint32_t));
  resident_.id = columns_[6].as<uint32_t>();
  resident_.window = shape_.windows.has_value() ? columns_[7].as<FrameWindow>() : nullptr;
  resident_.origin = nullptr;
  if (shape_.chunk_clocks) {
    L4D_RETURN_IF_ERROR(
        grow(n / kChunkSlots * sizeof(double), slots_ / kChunkSlots * sizeof(double), &origins_));
    resident_.origin = origins_.as<double>();
  }
  // As many chunks as batches can make of the slots.
  const size_t chunks = n / kChunkSlots + kMaxBatches + 1;
  L4D_RETURN_IF_ERROR(grow(chunks * sizeof(Chunk), num_chunks_ * sizeof(Chunk), &chunks_));
  slots_ = slots;
  return {};
}

void SceneStore::set_external_sh(const float* sh, uint32_t stride, uint32_t degree) {
  resident_.sh = const_cast<float*>(sh);  // frames only read it
  resident_.sh_words = stride;
  shape_.sh_degree = degree;
}

Status SceneStore::store_scene(const l4d_gaussians& gaussians) {
  const size_t n = static_cast<size_t>(gaussians.count);
  if (n > slots_ || gaussians.sh_degree != shape_.sh_degree) {
    return invalid_argument("the reserved capacity is too small for the scene");
  }
  const size_t words = (n + kGroupPiece - 1) / kGroupPiece * kNumMotionGroups + 1;
  cuda::DeviceMemory lists, states, counts;
  L4D_RETURN_IF_ERROR(lists.reserve(std::max<size_t>(n, 1) * kNumMotionGroups * sizeof(uint32_t)));
  L4D_RETURN_IF_ERROR(states.reserve(words * sizeof(uint32_t)));
  L4D_RETURN_IF_ERROR(counts.reserve(kNumMotionGroups * sizeof(uint32_t)));
  const cudaStream_t stream = nullptr;
  L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(states.data(), 0, words * sizeof(uint32_t), stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(counts.data(), 0, counts.size(), stream));
  launch_group(gaussians, shape_.sequence, lists.as<uint32_t>(), counts.as<uint32_t>(),
               states.as<uint32_t>(), stream);
  L4D_RETURN_IF_ERROR(launched("sorting slots by motion"));
  uint32_t lengths[kNumMotionGroups];
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpy(lengths, counts.data(), sizeof lengths, cudaMemcpyDeviceToHost));
  Batch batches[kNumMotionGroups];
  StorePlace place;
  place.origin = shape_.sequence.center();
  for (uint32_t group = 0; group < kNumMotionGroups; ++group) {
    place.list = lists.as<uint32_t>() + size_t{group} * n;
    place.count = lengths[group];
    launch_store(gaussians, shape_.sequence, place, shape_.half_sh, resident_, stream);
    batches[group] = {place.first, place.count, group};
    place.first += place.count;
  }
  L4D_RETURN_IF_ERROR(launched("storing slots"));
  L4D_RETURN_IF_ERROR(set_batches(batches, kNumMotionGroups, stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  return {};
}

Status SceneStore::set_batches(const Batch* batches, uint32_t count, cudaStream_t stream) {
  if (count > kMaxBatches) return invalid_argument("too many batches");
  uint64_t slots = 0;
  for (uint32_t s = 0; s < count; ++s) {
    slots += batches[s].count;
    if (batches[s].first > slots_ || batches[s].count > slots_ - batches[s].first ||
        batches[s].group >= kNumMotionGroups) {
      return invalid_argument("batch " + std::to_string(s) + " lies beyond the slots");
    }
  }
  if (slots > slots_) return invalid_argument("batches overlap");
  ++revision_;
  num_chunks_ = render::num_chunks(batches, count);
  launch_chunks(batches, count, chunks_.as<Chunk>(), stream);
  return launched("setting batches");
}

Status SceneStore::set_chunks(const Chunk* chunks, uint32_t count, cudaStream_t stream) {
  ++revision_;
  num_chunks_ = count;
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(chunks_.data(), chunks, count * sizeof(Chunk),
                                           cudaMemcpyHostToDevice, stream));
  return {};
}

}  // namespace l4d::render
