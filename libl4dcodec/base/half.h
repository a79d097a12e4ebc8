// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "libl4dcodec/math/hd.h"

namespace l4d {

// IEEE 754 binary16 <-> binary32 on bit patterns. Written in integers because compilers, _Float16
// and F16C differ in what they offer and in how they round; the codec needs the same bits
// everywhere.

constexpr uint16_t kHalfInfinity = 0x7c00;
constexpr uint16_t kHalfMax = 0x7bff;  // 65504

// Exact.
L4D_HOST_DEVICE inline float half_to_float(uint16_t half) {
  const uint32_t sign = (half & 0x8000u) << 16;
  const uint32_t exponent = (half >> 10) & 0x1fu;
  uint32_t mantissa = half & 0x3ffu;
  uint32_t bits;
  if (exponent == 0x1fu) {
    bits = 0x7f800000u | (mantissa << 13);
  } else if (exponent != 0) {
    bits = ((exponent + 112u) << 23) | (mantissa << 13);
  } else if (mantissa == 0) {
    bits = 0;
  } else {
    uint32_t biased = 113;  // exponent of 2^-14: a subnormal half is a normal float
    while ((mantissa & 0x400u) == 0) {
      mantissa <<= 1;
      --biased;
    }
    bits = (biased << 23) | ((mantissa & 0x3ffu) << 13);
  }
  bits |= sign;
  float value;
  memcpy(&value, &bits, sizeof(value));
  return value;
}

// Nearest, ties to even. |value| >= 65520 becomes infinity; NaN stays NaN.
L4D_HOST_DEVICE inline uint16_t float_to_half(float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof(bits));
  const uint32_t sign = (bits >> 16) & 0x8000u;
  const uint32_t magnitude = bits & 0x7fffffffu;
  uint32_t half;
  if (magnitude > 0x7f800000u) {
    half = 0x7e00u |
           ((magnitude >> 13) & 0x3ffu);  // quiet, so that truncation cannot make it infinity
  } else if (magnitude >= 0x477ff000u) {  // 65520, halfway from 65504 to 65536
    half = kHalfInfinity;
  } else if (magnitude >= 0x38800000u) {  // 2^-14, the smallest normal half
    // The carry out of the mantissa is the right exponent.
    half = (magnitude - 0x38000000u + 0xfffu + ((magnitude >> 13) & 1u)) >> 13;
  } else if (magnitude > 0x33000000u) {  // 2^-25, halfway from 0 to the smallest subnormal half
    const uint32_t mantissa = (magnitude & 0x7fffffu) | 0x800000u;
    const uint32_t shift = 126u - (magnitude >> 23);  // 14..24
    const uint32_t rest = mantissa & ((1u << shift) - 1u);
    const uint32_t tie = 1u << (shift - 1u);
    half = mantissa >> shift;
    half += (rest > tie || (rest == tie && (half & 1u) != 0)) ? 1u : 0u;
  } else {
    half = 0;
  }
  return static_cast<uint16_t>(sign | half);
}

// As float_to_half, with +-65504 where that gives an infinity.
L4D_HOST_DEVICE inline uint16_t float_to_half_saturate(float value) {
  const uint16_t half = float_to_half(value);
  if ((half & 0x7fffu) != kHalfInfinity) return half;
  return static_cast<uint16_t>((half & 0x8000u) | kHalfMax);
}

// As float_to_half_saturate, but that NaN becomes +-65504. Without branches, so that compilers make
// SIMD of it.
inline void floats_to_halves(const float* from, size_t n, uint16_t* to) {
  constexpr uint32_t kLargest = 0x477fe000u;         // 65504
  constexpr uint32_t kSmallestNormal = 0x38800000u;  // 2^-14
  for (size_t k = 0; k < n; ++k) {
    uint32_t bits;
    memcpy(&bits, from + k, sizeof(bits));
    const uint32_t sign = (bits >> 16) & 0x8000u;
    uint32_t magnitude = bits & 0x7fffffffu;
    magnitude = magnitude < kLargest ? magnitude : kLargest;
    const uint32_t normal = (magnitude - 0x38000000u + 0xfffu + ((magnitude >> 13) & 1u)) >> 13;
    // The last bit of 0.5 is that of subnormal halves, so that the addition rounds to it.
    float small;
    memcpy(&small, &magnitude, sizeof(small));
    small += 0.5f;
    uint32_t subnormal;
    memcpy(&subnormal, &small, sizeof(subnormal));
    subnormal -= 0x3f000000u;
    to[k] = static_cast<uint16_t>(sign | (magnitude < kSmallestNormal ? subnormal : normal));
  }
}

}  // namespace l4d
