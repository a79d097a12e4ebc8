// SPDX-License-Identifier: Apache-2.0
// From attributes in device arrays to resident slots.
#pragma once

#include "render/cuda/store/resident.h"

namespace l4d::render {

// Rows of one motion group that follow each other.
struct Batch {
  uint32_t first, count, group;
};
constexpr uint32_t kMaxBatches = 256;

// Sorts [0, gaussians.count) by motion group, each group in order: lists [kNumMotionGroups, count]
// and their lengths counts [kNumMotionGroups]. states: [kNumMotionGroups, pieces of kGroupPiece]
// and then a ticket, set to 0.
constexpr uint32_t kGroupPiece = 256;
void launch_group(const l4d_gaussians& gaussians, const Sequence& sequence, uint32_t* lists,
                  uint32_t* counts, uint32_t* states, cudaStream_t stream);

// Which slots are made, and of which Gaussians.
struct StorePlace {
  const uint32_t* list = nullptr;  // of Gaussians; NULL: 0, 1, ...
  const uint32_t* chunks =
      nullptr;  // chunks of kChunkSlots slots, one behind the other; NULL: `first` on
  uint32_t count = 0;
  uint32_t first = 0;
  uint32_t first_id = 0;    // ids are the Gaussians' numbers plus this
  double origin = 0;        // slots count time from here, in the clock of the Gaussians
  double chunk_origin = 0;  // of `chunks`, for ResidentGaussians.origin
};
#ifdef __CUDACC__
__device__ inline uint32_t gaussian_of(const StorePlace& place, uint32_t at) {
  return place.list != nullptr ? place.list[at] : at;
}
__device__ inline uint32_t row_of(const StorePlace& place, uint32_t at) {
  return place.chunks == nullptr ? place.first + at
                                 : place.chunks[at / kChunkSlots] * kChunkSlots + at % kChunkSlots;
}

// All of a slot but its SH. origin: what the slot's clock counts from, in the clock of `p`.
__device__ inline void store_slot(const Prepared& p, double origin, uint32_t id, uint32_t slot,
                                  const ResidentGaussians& slots) {
  const auto f = [](double v) { return static_cast<float>(v); };
  const double mean = p.mean - origin;
  const double* c = p.slice.covariance;
  const double* v = p.slice.velocity;
  slots.interval[slot] = interval_of(mean, p.half_life);
  slots.place[slot] =
      make_float4(f(p.position[0]), f(p.position[1]), f(p.position[2]), f(p.opacity));
  slots.motion[slot] = make_float4(f(v[0]), f(v[1]), f(v[2]), f(p.reference - origin));
  slots.shape0[slot] = make_float4(f(c[0]), f(c[1]), f(c[2]), f(c[3]));
  slots.shape1[slot] = make_float4(f(c[4]), f(c[5]), f(mean), f(p.slice.lambda));
  slots.id[slot] = id;
  if (slots.window != nullptr) slots.window[slot] = p.window;
}
#endif
void launch_store(const l4d_gaussians& gaussians, const Sequence& sequence, const StorePlace& place,
                  bool half_sh, const ResidentGaussians& slots, cudaStream_t stream);

// Returns how many chunks the batches are; chunks has room for them.
uint32_t num_chunks(const Batch* batches, uint32_t num_batches);
void launch_chunks(const Batch* batches, uint32_t num_batches, Chunk* chunks, cudaStream_t stream);

}  // namespace l4d::render
