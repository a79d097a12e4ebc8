// SPDX-License-Identifier: Apache-2.0
// Ordered integers: the bits of a float mapped so that integer order is numeric order, which makes
// differences of neighbours small (spec: "Ordered floats").
#pragma once

#include <cstdint>
#include <cstring>

namespace l4d {

inline uint16_t order_half(uint16_t bits) {
  return static_cast<uint16_t>(bits ^ ((bits & 0x8000u) != 0 ? 0xffffu : 0x8000u));
}
inline uint16_t unorder_half(uint16_t ordered) {
  return static_cast<uint16_t>(ordered ^ ((ordered & 0x8000u) != 0 ? 0x8000u : 0xffffu));
}
inline uint32_t order_float(float value) {
  uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits ^ ((bits & 0x80000000u) != 0 ? 0xffffffffu : 0x80000000u);
}
inline float unorder_float(uint32_t ordered) {
  const uint32_t bits = ordered ^ ((ordered & 0x80000000u) != 0 ? 0x80000000u : 0xffffffffu);
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}
inline uint64_t order_double(double value) {
  uint64_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits ^ (bits >> 63 != 0 ? ~uint64_t{0} : uint64_t{1} << 63);
}
inline double unorder_double(uint64_t ordered) {
  const uint64_t bits = ordered ^ (ordered >> 63 != 0 ? uint64_t{1} << 63 : ~uint64_t{0});
  double value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}
inline bool half_is_finite(uint16_t bits) { return (bits & 0x7c00u) != 0x7c00u; }

}  // namespace l4d
