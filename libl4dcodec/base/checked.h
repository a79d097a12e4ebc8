// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace l4d {

// The sum of numbers that come from a stream. Returns false, and leaves *out unchanged, if it does
// not fit in 64 bits.
[[nodiscard]] constexpr bool checked_add(uint64_t a, uint64_t b, uint64_t* out) {
  if (b > UINT64_MAX - a) return false;
  *out = a + b;
  return true;
}

// The smallest multiple of `alignment` (a power of two) that is not below `value`, which is at most
// 2^64 - `alignment`.
constexpr uint64_t align_up(uint64_t value, uint64_t alignment) {
  return (value + (alignment - 1)) & ~(alignment - 1);
}

// The largest number of 32 bits where it does not fit in them.
constexpr uint32_t saturate32(uint64_t v) {
  return v < UINT32_MAX ? static_cast<uint32_t>(v) : UINT32_MAX;
}

}  // namespace l4d
