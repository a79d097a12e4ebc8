// SPDX-License-Identifier: Apache-2.0
// Results of blocks that follow each other in order, in one pass: every block tells its count and
// learns the sum of the counts before it ("decoupled look-back").
#pragma once

#include <cstdint>

namespace l4d::render {

// A word of state per piece: what it holds in the two highest bits, a count below. 0 = nothing yet.
constexpr uint32_t kOwnCount = 1u << 30;
constexpr uint32_t kAllCounts = 2u << 30;
constexpr uint32_t kCountMask = (1u << 30) - 1;
constexpr uint32_t kFullWarp = 0xffffffffu;

__device__ inline uint32_t load_state(const uint32_t* state) {
  return *static_cast<const volatile uint32_t*>(state);
}
__device__ inline void store_state(uint32_t* state, uint32_t value) {
  *static_cast<volatile uint32_t*>(state) = value;
}

// Sum over the lanes of a full warp, in each of them.
__device__ inline uint32_t sum_of_warp(uint32_t value) {
#if __CUDA_ARCH__ >= 800
  return __reduce_add_sync(kFullWarp, value);
#else
  for (int distance = 16; distance > 0; distance /= 2) {
    value += __shfl_xor_sync(kFullWarp, value, distance);
  }
  return value;
#endif
}

// The number of the block's piece of work. Numbers are taken in order, so a block that waits for a
// lower one waits for a block that runs.
__device__ inline uint32_t take_ticket(uint32_t* counter) {
  __shared__ uint32_t ticket;
  __syncthreads();  // of the call before
  if (threadIdx.x == 0) ticket = atomicAdd(counter, 1u);
  __syncthreads();
  return ticket;
}

// A piece counts at most this; a sum stays at kCountMask once it gets there. So nothing wraps,
// whatever there is to count, and a sum above kMostCounted is known to be too large.
constexpr uint32_t kMostCounted = 1u << 26;

// Sum of the counts of all pieces before `piece`. Called by one full warp with the same arguments.
__device__ inline uint32_t sum_before(uint32_t* states, uint32_t piece, uint32_t count) {
  const uint32_t lane = threadIdx.x & 31;
  count = min(count, kMostCounted);
  if (piece == 0) {
    if (lane == 0) store_state(states, kAllCounts | count);
    return 0;
  }
  if (lane == 0) store_state(states + piece, kOwnCount | count);
  uint32_t sum = 0;
  for (int64_t end = piece;; end -= 32) {
    const int64_t at = end - 1 - lane;  // the nearest first
    uint32_t state = kAllCounts;
    do {
      if (at >= 0) state = load_state(states + at);
    } while (__any_sync(kFullWarp, (state >> 30) == 0));
    const uint32_t whole = __ballot_sync(kFullWarp, (state >> 30) == 2);
    const uint32_t last =
        whole != 0 ? static_cast<uint32_t>(__ffs(static_cast<int>(whole)) - 1) : 31;
    // The one that holds all counts may be large: it is added on its own.
    const bool all = whole != 0 && lane == last;
    const uint32_t owns = lane < last || (lane == last && !all) ? state & kCountMask : 0u;
    sum = min(sum + sum_of_warp(owns), kCountMask);
    if (whole != 0) {
      sum = min(sum + (__shfl_sync(kFullWarp, state, static_cast<int>(last)) & kCountMask),
                kCountMask);
      break;
    }
  }
  if (lane == 0) store_state(states + piece, kAllCounts | min(sum + count, kCountMask));
  return sum;
}

// Sum over the lanes before, inclusive.
__device__ inline uint32_t warp_sum_until(uint32_t value) {
  const uint32_t lane = threadIdx.x & 31;
  for (uint32_t step = 1; step < 32; step *= 2) {
    const uint32_t other = __shfl_up_sync(kFullWarp, value, step);
    if (lane >= step) value += other;
  }
  return value;
}

// Exclusive sum over the threads of a block of kThreads; *total is the sum of all.
template <int kThreads>
__device__ inline uint32_t block_sum_before(uint32_t value, uint32_t* total) {
  constexpr int kWarps = kThreads / 32;
  __shared__ uint32_t sums[kWarps + 1];
  const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  const uint32_t until = warp_sum_until(value);
  __syncthreads();  // of the call before
  if (lane == 31) sums[warp] = until;
  __syncthreads();
  if (warp == 0) {
    const uint32_t own = lane < kWarps ? sums[lane] : 0;
    const uint32_t all = warp_sum_until(own);
    if (lane < kWarps) sums[lane] = all - own;
    if (lane == kWarps - 1) sums[kWarps] = all;
  }
  __syncthreads();
  *total = sums[kWarps];
  return sums[warp] + until - value;
}

}  // namespace l4d::render
