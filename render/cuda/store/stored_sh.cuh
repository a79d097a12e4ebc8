// SPDX-License-Identifier: Apache-2.0
// SH of a resident slot, in registers: load() starts loads, finish() is called where the numbers
// are needed.
#pragma once

#include <cuda_fp16.h>

#include "render/cuda/store/resident.h"

namespace l4d::render {

// A slot of numbers as it is stored.
template <uint32_t kDegree, bool kHalf>
struct ShRow {
  static constexpr uint32_t kStride = sh_stride(kDegree, kHalf);
  static constexpr uint32_t kWords = kHalf ? kStride / 2 : kStride;  // of 4 bytes
  uint32_t words[kWords];

  __device__ void load(const void* slots, uint32_t slot, uint32_t stride = kWords) {
    const uint32_t* from = static_cast<const uint32_t*>(slots) + size_t{slot} * stride;
    if constexpr (kWords % 4 == 0) {
#pragma unroll
      for (uint32_t w = 0; w < kWords; w += 4) {
        const uint4 v = __ldg(reinterpret_cast<const uint4*>(from + w));
        words[w] = v.x;
        words[w + 1] = v.y;
        words[w + 2] = v.z;
        words[w + 3] = v.w;
      }
    } else {
      const uint2 v = __ldg(reinterpret_cast<const uint2*>(from));
      words[0] = v.x;
      words[1] = v.y;
    }
  }
  __device__ float operator[](uint32_t k) const {
    if constexpr (!kHalf) {
      return __uint_as_float(words[k]);
    } else {
      const uint32_t bits = words[k / 2] >> (k % 2 * 16);
      return __half2float(__ushort_as_half(static_cast<unsigned short>(bits)));
    }
  }
};

// Of slots that hold their coefficients.
template <uint32_t kDegree, bool kHalf>
struct CoefficientSh : ShRow<kDegree, kHalf> {
  __device__ void load(const ResidentGaussians& slots, uint32_t slot) {
    ShRow<kDegree, kHalf>::load(slots.sh, slot, slots.sh_words);
  }
  __device__ void finish(const ResidentGaussians&, uint32_t) {}
};

// Of slots that hold indices: codewords are added up in the order of their stages, as decoders do.
template <uint32_t kDegree, bool kHalf>
struct IndexedSh {
  static constexpr uint32_t kNumbers = 3 * sh_terms(kDegree);
  float numbers[kNumbers];
  ShRow<kDegree, kHalf> first;
  uint32_t code;

  __device__ static const uint32_t* words_of(const ResidentGaussians& slots, uint32_t slot) {
    return static_cast<const uint32_t*>(slots.sh) + size_t{slot} * slots.codebooks.words();
  }
  __device__ uint32_t depth() const { return code % (1u << kShDepthBits); }
  __device__ void load(const ResidentGaussians& slots, uint32_t slot) {
    code = __ldg(words_of(slots, slot));
    if (depth() != 0 && depth() != kShEscape) first.load(slots.codebooks.codebook[0], code >> 16);
  }
  __device__ void finish(const ResidentGaussians& slots, uint32_t slot) {
    if (depth() == kShEscape) {
      ShRow<kDegree, true> escape;
      escape.load(slots.codebooks.escapes, code >> kShDepthBits);
#pragma unroll
      for (uint32_t k = 0; k < kNumbers; ++k) numbers[k] = escape[k];
      return;
    }
#pragma unroll
    for (uint32_t k = 0; k < kNumbers; ++k) numbers[k] = depth() != 0 ? first[k] : 0.0f;
    const uint32_t* words = words_of(slots, slot);
    for (uint32_t s = 1; s < depth(); ++s) {
      const uint32_t pair = __ldg(words + 1 + (s - 1) / 2);
      ShRow<kDegree, kHalf> next;
      next.load(slots.codebooks.codebook[s], (s - 1) % 2 == 0 ? pair & 0xffff : pair >> 16);
#pragma unroll
      for (uint32_t k = 0; k < kNumbers; ++k) numbers[k] += next[k];
    }
  }
  __device__ float operator[](uint32_t k) const { return numbers[k]; }
};

}  // namespace l4d::render
