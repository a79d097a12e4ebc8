// SPDX-License-Identifier: Apache-2.0
// Numbers of files, whatever the order of the machine's bytes.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

namespace l4d::io {

inline uint16_t little_endian16(const uint8_t* bytes) {
  return static_cast<uint16_t>(bytes[0] | bytes[1] << 8);
}
inline uint32_t little_endian32(const uint8_t* bytes) {
  return little_endian16(bytes) | static_cast<uint32_t>(little_endian16(bytes + 2)) << 16;
}
inline uint64_t little_endian64(const uint8_t* bytes) {
  return little_endian32(bytes) | static_cast<uint64_t>(little_endian32(bytes + 4)) << 32;
}
inline float little_endian_float(const uint8_t* bytes) {
  const uint32_t bits = little_endian32(bytes);
  float value = 0;
  std::memcpy(&value, &bits, sizeof(value));
  return value;
}
// IEEE 754 binary16; exact.
inline double half_of_bits(uint16_t bits) {
  const int exponent = (bits >> 10) & 31, fraction = bits & 1023;
  double value = std::ldexp(fraction, -24);
  if (exponent == 31) value = fraction != 0 ? std::nan("") : HUGE_VAL;
  if (exponent > 0 && exponent < 31) value = std::ldexp(1024 + fraction, exponent - 25);
  return (bits >> 15) != 0 ? -value : value;
}
inline double little_endian_half(const uint8_t* bytes) {
  return half_of_bits(little_endian16(bytes));
}

// The lowest `bytes` of a number, at most 8.
inline void append_little_endian(std::vector<uint8_t>* to, uint64_t value, unsigned bytes) {
  for (unsigned b = 0; b < bytes; ++b) to->push_back(static_cast<uint8_t>(value >> (8 * b)));
}

}  // namespace l4d::io
