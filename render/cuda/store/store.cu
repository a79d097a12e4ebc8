// SPDX-License-Identifier: Apache-2.0
#include <cuda_fp16.h>

#include "render/cuda/kernel/launch.cuh"
#include "render/cuda/kernel/ordered.cuh"
#include "render/cuda/store/store.h"

namespace l4d::render {
namespace {

constexpr int kThreads = 256;
static_assert(kGroupPiece == kThreads, "one Gaussian per thread");

__global__ void __launch_bounds__(kThreads)
    group_gaussians(l4d_gaussians gaussians, Sequence sequence, uint32_t* lists, uint32_t* counts,
                    uint32_t* states) {
  await_predecessor();
  __shared__ uint32_t before[kNumMotionGroups][kThreads / 32];
  const uint32_t n = static_cast<uint32_t>(gaussians.count);
  const uint32_t piece = take_ticket(states + size_t{kNumMotionGroups} * gridDim.x);
  const uint32_t i = piece * kThreads + threadIdx.x;
  const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  uint32_t group = kNumMotionGroups;
  if (i < n) {
    group = group_of(prepare_gaussian(gaussians, sequence, i), sequence);
  }
  uint32_t own_votes = 0;
  for (uint32_t g = 0; g < kNumMotionGroups; ++g) {
    const uint32_t votes = __ballot_sync(kFullWarp, group == g);
    if (lane == 0) before[g][warp] = static_cast<uint32_t>(__popc(votes));
    if (group == g) own_votes = votes;
  }
  __syncthreads();
  if (warp < kNumMotionGroups) {
    const uint32_t own = lane < kThreads / 32 ? before[warp][lane] : 0;
    const uint32_t until = warp_sum_until(own);
    const uint32_t total = __shfl_sync(kFullWarp, until, 31);
    const uint32_t base = sum_before(states + size_t{warp} * gridDim.x, piece, total);
    if (lane < kThreads / 32) before[warp][lane] = base + until - own;
    if (lane == 0 && piece + 1 == gridDim.x) counts[warp] = base + total;
  }
  __syncthreads();
  if (i >= n) return;
  const uint32_t to =
      before[group][warp] + static_cast<uint32_t>(__popc(own_votes & ((1u << lane) - 1)));
  lists[size_t{group} * n + to] = i;
}

__global__ void __launch_bounds__(kThreads)
    store_gaussians(l4d_gaussians gaussians, Sequence sequence, StorePlace to,
                    ResidentGaussians slots) {
  await_predecessor();
  const uint32_t at = blockIdx.x * kThreads + threadIdx.x;
  if (at >= to.count) return;
  const uint32_t i = gaussian_of(to, at), slot = row_of(to, at);
  store_slot(prepare_gaussian(gaussians, sequence, i), to.origin, to.first_id + i, slot, slots);
  if (to.chunks != nullptr && at % kChunkSlots == 0)
    slots.origin[slot / kChunkSlots] = to.chunk_origin;
}

template <bool kHalf>
__global__ void __launch_bounds__(kThreads)
    store_sh(const float* sh, uint32_t numbers, uint32_t stride, StorePlace place, void* out) {
  await_predecessor();
  const size_t total = size_t{place.count} * stride, step = size_t{gridDim.x} * kThreads;
  for (size_t k = size_t{blockIdx.x} * kThreads + threadIdx.x; k < total; k += step) {
    const uint32_t at = static_cast<uint32_t>(k / stride),
                   number = static_cast<uint32_t>(k % stride);
    const uint32_t i = gaussian_of(place, at);
    const float v = number < numbers ? sh[size_t{i} * numbers + number] : 0.0f;
    const size_t to = size_t{row_of(place, at)} * stride + number;
    if (kHalf) {
      static_cast<__half*>(out)[to] = __float2half_rn(v);
    } else {
      static_cast<float*>(out)[to] = v;
    }
  }
}

struct BatchTable {
  Batch batches[kMaxBatches];
  uint32_t count;
};

// A block per batch.
__global__ void make_chunks(BatchTable table, Chunk* chunks) {
  await_predecessor();
  uint32_t to = 0;
  for (uint32_t s = 0; s < blockIdx.x; ++s) {
    to += (table.batches[s].count + kChunkSlots - 1) / kChunkSlots;
  }
  const Batch batch = table.batches[blockIdx.x];
  for (uint32_t k = threadIdx.x; k * kChunkSlots < batch.count; k += blockDim.x) {
    const uint32_t from = k * kChunkSlots;
    chunks[to + k] = {batch.first + from, min(kChunkSlots, batch.count - from), batch.group};
  }
}

}  // namespace

void launch_group(const l4d_gaussians& gaussians, const Sequence& sequence, uint32_t* lists,
                  uint32_t* counts, uint32_t* states, cudaStream_t stream) {
  const unsigned grid = static_cast<unsigned>((gaussians.count + kThreads - 1) / kThreads);
  if (grid == 0) return;
  launch(group_gaussians, grid, kThreads, stream, gaussians, sequence, lists, counts, states);
}

void launch_store(const l4d_gaussians& gaussians, const Sequence& sequence, const StorePlace& place,
                  bool half_sh, const ResidentGaussians& slots, cudaStream_t stream) {
  if (place.count == 0) return;
  const unsigned grid = (place.count + kThreads - 1) / kThreads;
  launch(store_gaussians, grid, kThreads, stream, gaussians, sequence, place, slots);
  const uint32_t numbers = 3 * sh_terms(gaussians.sh_degree);
  const uint32_t stride = sh_stride(gaussians.sh_degree, half_sh);
  const unsigned blocks = grid < 4096 ? grid : 4096;
  if (half_sh) {
    launch(store_sh<true>, blocks, kThreads, stream, gaussians.sh, numbers, stride, place,
           slots.sh);
  } else {
    launch(store_sh<false>, blocks, kThreads, stream, gaussians.sh, numbers, stride, place,
           slots.sh);
  }
}

uint32_t num_chunks(const Batch* batches, uint32_t num_batches) {
  uint32_t n = 0;
  for (uint32_t s = 0; s < num_batches; ++s)
    n += (batches[s].count + kChunkSlots - 1) / kChunkSlots;
  return n;
}

void launch_chunks(const Batch* batches, uint32_t num_batches, Chunk* chunks, cudaStream_t stream) {
  if (num_batches == 0) return;
  BatchTable table{};
  for (uint32_t s = 0; s < num_batches; ++s) table.batches[s] = batches[s];
  table.count = num_batches;
  launch(make_chunks, num_batches, 256, stream, table, chunks);
}

}  // namespace l4d::render
