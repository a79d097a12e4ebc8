// SPDX-License-Identifier: Apache-2.0
// Morton codes of three coordinates of up to 21 bits: bit b of coordinate k is bit 3 b + k of the
// code.
#pragma once

#include <cstdint>

namespace l4d {

inline uint64_t morton_spread(uint32_t coordinate) {
  uint64_t v = coordinate & 0x1fffffu;
  v = (v | v << 32) & 0x001f00000000ffffull;
  v = (v | v << 16) & 0x001f0000ff0000ffull;
  v = (v | v << 8) & 0x100f00f00f00f00full;
  v = (v | v << 4) & 0x10c30c30c30c30c3ull;
  v = (v | v << 2) & 0x1249249249249249ull;
  return v;
}

// The coordinate in bits 0, 3, 6, ..; other bits are ignored.
inline uint32_t morton_coordinate(uint64_t v) {
  v &= 0x1249249249249249ull;
  v = (v ^ v >> 2) & 0x10c30c30c30c30c3ull;
  v = (v ^ v >> 4) & 0x100f00f00f00f00full;
  v = (v ^ v >> 8) & 0x001f0000ff0000ffull;
  v = (v ^ v >> 16) & 0x001f00000000ffffull;
  v = (v ^ v >> 32) & 0x1fffffull;
  return static_cast<uint32_t>(v);
}

inline uint64_t morton_code(uint32_t x, uint32_t y, uint32_t z) {
  return morton_spread(x) | morton_spread(y) << 1 | morton_spread(z) << 2;
}

}  // namespace l4d
