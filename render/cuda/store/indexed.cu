// SPDX-License-Identifier: Apache-2.0
#include <cuda_fp16.h>

#include "render/cuda/kernel/launch.cuh"
#include "render/cuda/kernel/ordered.cuh"
#include "render/cuda/store/indexed.h"

namespace l4d::render {
namespace {

constexpr int kThreads = 256;
static_assert(kRankPiece == kThreads, "one Gaussian per thread");
constexpr uint8_t kPackedEscape = 255;  // as decoders tell them

__global__ void __launch_bounds__(kThreads)
    rank_escapes(const uint8_t* depth, uint32_t count, uint32_t* ranks, uint32_t* states) {
  await_predecessor();
  __shared__ uint32_t before_piece;
  const uint32_t piece = take_ticket(states + gridDim.x);
  const uint32_t i = piece * kThreads + threadIdx.x;
  const uint32_t own = i < count && depth[i] == kPackedEscape ? 1 : 0;
  uint32_t total = 0;
  const uint32_t before = block_sum_before<kThreads>(own, &total);
  if (threadIdx.x < 32) {
    const uint32_t base = sum_before(states, piece, total);
    if (threadIdx.x == 0) before_piece = base;
  }
  __syncthreads();
  if (i < count) ranks[i] = before_piece + before;
}

__global__ void __launch_bounds__(kThreads)
    store_indices(ShIndices indices, StorePlace place, ResidentGaussians slots) {
  await_predecessor();
  const uint32_t at = blockIdx.x * kThreads + threadIdx.x;
  if (at >= place.count) return;
  const uint32_t i = gaussian_of(place, at);
  const ShCodebookTable& codebooks = slots.codebooks;
  uint32_t* words =
      static_cast<uint32_t*>(slots.sh) + size_t{row_of(place, at)} * codebooks.words();
  uint32_t depth = indices.depth != nullptr ? indices.depth[i] : codebooks.num_stages;
  if (depth == kPackedEscape) {
    const uint32_t rank = indices.rank != nullptr ? indices.rank[i] : 0;
    if (indices.rank != nullptr && rank < indices.num_escapes) {
      words[0] = kShEscape | rank << kShDepthBits;
      return;
    }
    depth = 0;
  }
  depth = min(depth, codebooks.num_stages);
  const auto index_of = [&](uint32_t s) {
    if (s >= depth) return 0u;
    return min(uint32_t{indices.index[s * indices.stride + i]}, codebooks.entries[s] - 1);
  };
  words[0] = depth | index_of(0) << 16;
  for (uint32_t s = 1; s < codebooks.num_stages; s += 2) {
    words[1 + s / 2] = index_of(s) | index_of(s + 1) << 16;
  }
}

__device__ inline void convert(float from, float* to) { *to = from; }
__device__ inline void convert(float from, __half* to) { *to = __float2half_rn(from); }
__device__ inline void convert(uint16_t from, uint16_t* to) { *to = from; }

template <typename From, typename To>
__global__ void __launch_bounds__(kThreads)
    pad_rows(const From* from, uint32_t numbers, uint32_t stride, uint32_t count, To* to) {
  await_predecessor();
  const size_t total = size_t{count} * stride, step = size_t{gridDim.x} * kThreads;
  for (size_t k = size_t{blockIdx.x} * kThreads + threadIdx.x; k < total; k += step) {
    const size_t row = k / stride, number = k % stride;
    convert(number < numbers ? from[row * numbers + number] : From{0}, to + k);
  }
}

template <typename From, typename To>
void launch_pad(const From* from, uint32_t numbers, uint32_t stride, uint32_t count, To* to,
                cudaStream_t stream) {
  if (count == 0) return;
  const size_t blocks = (size_t{count} * stride + kThreads - 1) / kThreads;
  launch(pad_rows<From, To>, static_cast<unsigned>(blocks < 4096 ? blocks : 4096), kThreads, stream,
         from, numbers, stride, count, to);
}

}  // namespace

void launch_rank_escapes(const uint8_t* depth, uint32_t count, uint32_t* ranks, uint32_t* states,
                         cudaStream_t stream) {
  if (count == 0) return;
  launch(rank_escapes, (count + kThreads - 1) / kThreads, kThreads, stream, depth, count, ranks,
         states);
}

void launch_store_indices(const ShIndices& indices, const StorePlace& place,
                          const ResidentGaussians& slots, cudaStream_t stream) {
  if (place.count == 0) return;
  launch(store_indices, (place.count + kThreads - 1) / kThreads, kThreads, stream, indices, place,
         slots);
}

void launch_pad_codebooks(const float* from, uint32_t numbers, uint32_t stride, uint32_t count,
                          bool half, void* to, cudaStream_t stream) {
  if (half) {
    launch_pad(from, numbers, stride, count, static_cast<__half*>(to), stream);
  } else {
    launch_pad(from, numbers, stride, count, static_cast<float*>(to), stream);
  }
}

void launch_pad_escapes(const uint16_t* from, uint32_t numbers, uint32_t stride, uint32_t count,
                        uint16_t* to, cudaStream_t stream) {
  launch_pad(from, numbers, stride, count, to, stream);
}

}  // namespace l4d::render
