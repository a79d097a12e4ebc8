// SPDX-License-Identifier: Apache-2.0
// Single values on the device: the formulas of libl4dcodec/base/ordered.h, container/morton.h and
// container/page.h, whose functions are for the host.
#pragma once

#include <cstdint>

namespace l4d::cuda {

__device__ inline uint16_t unordered_half(uint32_t ordered) {
  return static_cast<uint16_t>(ordered ^ ((ordered & 0x8000u) != 0 ? 0x8000u : 0xffffu));
}
__device__ inline bool is_finite_half(uint16_t bits) { return (bits & 0x7c00u) != 0x7c00u; }

__device__ inline int32_t unzigzag(uint32_t z) {
  return static_cast<int16_t>(static_cast<uint16_t>((z >> 1) ^ (0u - (z & 1u))));
}

// The coordinate in bits 0, 3, 6, ..; other bits are ignored.
__device__ inline uint32_t morton_axis(uint64_t v) {
  v &= 0x1249249249249249ull;
  v = (v ^ v >> 2) & 0x10c30c30c30c30c3ull;
  v = (v ^ v >> 4) & 0x100f00f00f00f00full;
  v = (v ^ v >> 8) & 0x001f0000ff0000ffull;
  v = (v ^ v >> 16) & 0x001f00000000ffffull;
  v = (v ^ v >> 32) & 0x1fffffull;
  return static_cast<uint32_t>(v);
}

}  // namespace l4d::cuda
