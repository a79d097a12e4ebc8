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

// The integer nearest to a number, within a range; what is no number becomes 0. Converting it as it
// is would be undefined.
template <typename Int>
Int nearest_code(double v, double low, double high) {
  return std::isnan(v) ? Int{0} : static_cast<Int>(std::clamp(std::nearbyint(v), low, high));
}

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
  return nearest_code<uint16_t>(code, 0, (1u << coding.bits) - 1u);
}

// What `value` is decoded to.
inline float scalar_value(const ScalarCoding& coding, float value) {
  return coding.coding == ScalarCodingId::kSq
             ? coding.offset + coding.step * static_cast<float>(scalar_code(coding, value))
             : coding.offset;
}

}  // namespace l4d
