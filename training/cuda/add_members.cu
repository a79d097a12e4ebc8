// SPDX-License-Identifier: Apache-2.0
#include "training/cuda/add_members.h"

namespace l4d::train {
namespace {

constexpr uint32_t kThreads = 256;
constexpr uint64_t kMaxBlocks = 1024;  // of an array

struct Plus {
  __device__ float operator()(float a, float b) const { return a + b; }
  __device__ uint32_t operator()(uint32_t a, uint32_t b) const { return a + b; }
  __device__ float4 operator()(const float4& a, const float4& b) const {
    return make_float4(a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w);
  }
};
struct Union {
  __device__ uint8_t operator()(uint8_t a, uint8_t b) const { return static_cast<uint8_t>(a | b); }
};

// Numbers [first, end) of T.
template <typename T, typename Add>
__device__ void add_numbers(const MemberArrays& all, const MemberArray& a, uint64_t first,
                            uint64_t end, const Add& add) {
  const uint64_t stride = uint64_t{gridDim.x} * kThreads;
  for (uint64_t i = first + uint64_t{blockIdx.x} * kThreads + threadIdx.x; i < end; i += stride) {
    T sum = static_cast<const T*>(a.from[0])[i];
    for (uint32_t k = 1; k < all.members; ++k) sum = add(sum, static_cast<const T*>(a.from[k])[i]);
    for (uint32_t k = 0; k < all.targets; ++k) static_cast<T*>(a.to[k])[i] = sum;
  }
}

// A row of blocks for each array.
__global__ void __launch_bounds__(kThreads) add_members(MemberArrays all) {
  if (blockIdx.x == 0 && blockIdx.y == 0 && threadIdx.x == 0) {
    uint32_t any = 0;
    for (uint32_t k = 0; k < all.members; ++k) any |= *all.stop[k];
    *all.stop_any = any;
  }
  if (blockIdx.y >= all.arrays) return;
  const MemberArray& a = all.array[blockIdx.y];
  if (a.kind == SumArray::kFlag) {
    add_numbers<uint8_t>(all, a, 0, a.numbers, Union());
  } else if (a.kind == SumArray::kCount) {
    add_numbers<uint32_t>(all, a, 0, a.numbers, Plus());
  } else {
    const uint64_t words = a.in_words ? a.numbers / 4 : 0;
    add_numbers<float4>(all, a, 0, words, Plus());
    add_numbers<float>(all, a, 4 * words, a.numbers, Plus());
  }
}

}  // namespace

void launch_add_members(const MemberArrays& arrays, cudaStream_t stream) {
  uint64_t most = 1;
  for (uint32_t k = 0; k < arrays.arrays; ++k) {
    const uint64_t n =
        arrays.array[k].in_words ? arrays.array[k].numbers / 4 : arrays.array[k].numbers;
    most = n > most ? n : most;
  }
  const uint64_t blocks = (most + kThreads - 1) / kThreads;
  const dim3 grid(static_cast<unsigned>(blocks < kMaxBlocks ? blocks : kMaxBlocks),
                  arrays.arrays > 0 ? arrays.arrays : 1);
  add_members<<<grid, kThreads, 0, stream>>>(arrays);
}

}  // namespace l4d::train
