// SPDX-License-Identifier: Apache-2.0
// Scalar quantisation: uniform steps over the range that occurs.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "libl4dcodec/container/scene_header.h"

namespace l4d {

// The format forbids tiny non-zero constants, whose arithmetic could be subnormal.
inline float sound_constant(float v) { return std::fabs(v) < 0x1p-40f ? 0.0f : v; }

// A constant where all values agree, else 2^bits codes from the smallest to the largest value.
inline ScalarCoding choose_scalar_coding(const std::vector<float>& values, unsigned bits) {
  ScalarCoding coding;
  if (values.empty()) return coding;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  coding.offset = sound_constant(*low);
  const float last = static_cast<float>((1u << bits) - 1u);
  float step = (*high - coding.offset) / last;
  if (step < 0x1p-40f) return coding;
  // Rounded up, the last code could decode to more than any value: to an opacity above 1.
  while (coding.offset + step * last > *high) step = std::nextafter(step, 0.0f);
  coding.coding = ScalarCodingId::kSq;
  coding.bits = bits;
  coding.step = step;
  return coding;
}

inline uint16_t scalar_code(const ScalarCoding& coding, float value) {
  if (coding.coding != ScalarCodingId::kSq) return 0;
  const double code = (static_cast<double>(value) - static_cast<double>(coding.offset)) /
                      static_cast<double>(coding.step);
  return static_cast<uint16_t>(
      std::clamp<double>(std::nearbyint(code), 0, (1u << coding.bits) - 1u));
}

}  // namespace l4d
