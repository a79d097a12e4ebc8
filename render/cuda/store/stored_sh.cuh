// SPDX-License-Identifier: Apache-2.0
// SH of a resident slot, in registers.
#pragma once

#include <cuda_fp16.h>

#include "render/cuda/store/resident.h"

namespace l4d::render {

template <uint32_t kDegree, bool kHalf>
struct StoredSh {
  static constexpr uint32_t kStride = sh_stride(kDegree, kHalf);
  static constexpr uint32_t kWords = kHalf ? kStride / 2 : kStride;  // of 4 bytes
  uint32_t words[kWords];

  // Starts the loads.
  __device__ void load(const ResidentGaussians& slots, uint32_t slot) {
    const uint32_t* from = static_cast<const uint32_t*>(slots.sh) + size_t{slot} * slots.sh_words;
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

}  // namespace l4d::render
