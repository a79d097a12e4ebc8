// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace l4d {

// Arithmetic on numbers that come from a stream. Each returns false, and leaves *out alone, where
// the result does not fit in 64 bits.

[[nodiscard]] constexpr bool checked_add(uint64_t a, uint64_t b, uint64_t* out) {
  if (b > UINT64_MAX - a) return false;
  *out = a + b;
  return true;
}

[[nodiscard]] constexpr bool checked_mul(uint64_t a, uint64_t b, uint64_t* out) {
  if (b != 0 && a > UINT64_MAX / b) return false;
  *out = a * b;
  return true;
}

// The smallest multiple of `alignment` (a power of two) that is not below `value`.
[[nodiscard]] constexpr bool checked_align_up(uint64_t value, uint64_t alignment, uint64_t* out) {
  uint64_t bumped = 0;
  if (!checked_add(value, alignment - 1, &bumped)) return false;
  *out = bumped & ~(alignment - 1);
  return true;
}

// The same for values known to be at least `alignment` away from the end of the range.
constexpr uint64_t align_up(uint64_t value, uint64_t alignment) {
  return (value + (alignment - 1)) & ~(alignment - 1);
}

// The largest number of 32 bits where it does not fit in them.
constexpr uint32_t saturate32(uint64_t v) {
  return v < UINT32_MAX ? static_cast<uint32_t>(v) : UINT32_MAX;
}

}  // namespace l4d
