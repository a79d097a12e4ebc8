// SPDX-License-Identifier: Apache-2.0
// A stable radix sort of pairs whose number only the device knows: one pass over memory per digit,
// each piece learning from those before it where its keys go. The maker of the keys counts their
// digits.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

namespace l4d::render {

constexpr int kMaxSortPasses = 4;
constexpr int kSortRadix = 256;

struct SortDigits {
  int passes;
  int bits[kMaxSortPasses];  // of each pass
  int shift[kMaxSortPasses];
};
// As even a cut of `bits` as there is, so that no pass has more digits than it needs.
SortDigits sort_digits(int bits);

struct SortBuffers {
  uint32_t* keys[2];      // [capacity]
  uint32_t* values[2];    // [capacity]
  const uint32_t* count;  // on the device, <= capacity
  uint32_t capacity;
  uint32_t* histograms;  // [passes, kSortRadix] how many keys have each digit
  // Set to 0 before each sort: sort_state_words() of states, and a ticket per pass.
  uint32_t* states;
  uint32_t* tickets;
};

size_t sort_state_words(uint32_t capacity, int bits);

// Sorts by bits [0, bits) of the keys. Takes keys[0] and, unless iota, values[0]; iota stands for
// the values 0, 1, 2, ... Results are in keys[*where] and values[*where].
void sort_pairs(const SortBuffers& buffers, int bits, bool iota, int* where, cudaStream_t stream);

#ifdef __CUDACC__
// Digits of the keys that a block makes, [kMaxSortPasses * kSortRadix] in shared memory: cleared by
// the block, counted key by key, and added to those of all by the block; barriers between.
template <int kThreads>
__device__ inline void clear_digits(const SortDigits& digits, uint32_t* own) {
  for (int i = static_cast<int>(threadIdx.x); i < digits.passes * kSortRadix; i += kThreads)
    own[i] = 0;
}
__device__ inline void count_digits(const SortDigits& digits, uint32_t key, uint32_t* own) {
#pragma unroll
  for (int p = 0; p < kMaxSortPasses; ++p) {
    if (p >= digits.passes) break;
    atomicAdd(own + p * kSortRadix + ((key >> digits.shift[p]) & ((1u << digits.bits[p]) - 1)), 1u);
  }
}
template <int kThreads>
__device__ inline void add_digits(const SortDigits& digits, const uint32_t* own,
                                  uint32_t* histograms) {
  for (int i = static_cast<int>(threadIdx.x); i < digits.passes * kSortRadix; i += kThreads) {
    if (own[i] != 0) atomicAdd(histograms + i, own[i]);
  }
}
#endif

}  // namespace l4d::render
