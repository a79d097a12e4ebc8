// SPDX-License-Identifier: Apache-2.0
// Streams written by hand, in any layout, valid or not: the library's encoder picks layouts by size
// and never writes an invalid one. Written from the specification, without the library's code.
#pragma once

#include <cstdint>
#include <vector>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/entropy/zstd_codec.h"

namespace l4d::test {

constexpr uint8_t kPackedMode = 0, kPlanesMode = 1, kConstantMode = 2, kDeltaMode = 4;

template <typename T>
std::vector<T> delta_of(const std::vector<T>& values) {
  std::vector<T> out;
  T previous = 0;
  for (const T v : values) {
    const T d = static_cast<T>(v - previous);
    const bool negative = (d >> (8 * sizeof(T) - 1)) != 0;
    out.push_back(
        static_cast<T>(static_cast<T>(d << 1) ^ (negative ? static_cast<T>(~T{0}) : T{0})));
    previous = v;
  }
  return out;
}

template <typename T>
Bytes packed_stream(std::vector<T> values, unsigned width, bool delta = false) {
  if (delta) values = delta_of(values);
  Bytes out{static_cast<uint8_t>(kPackedMode | (delta ? kDeltaMode : 0))};
  uint64_t buffer = 0;
  unsigned held = 0;
  for (const T v : values) {
    buffer |= uint64_t{v} << held;
    held += width;
    for (; held >= 8; held -= 8, buffer >>= 8) out.push_back(static_cast<unsigned char>(buffer));
  }
  if (held > 0) out.push_back(static_cast<unsigned char>(buffer));
  return out;
}

// codecs: bit p set = channel p is compressed.
template <typename T>
Bytes planes_stream(std::vector<T> values, unsigned width, bool delta = false,
                    unsigned codecs = 0) {
  if (delta) values = delta_of(values);
  Bytes out{static_cast<uint8_t>(kPlanesMode | (delta ? kDeltaMode : 0))};
  for (unsigned p = 0; p < (width + 7) / 8; ++p) {
    Bytes channel;
    for (const T v : values) channel.push_back(static_cast<unsigned char>(v >> (8 * p)));
    if ((codecs >> p & 1) != 0) {
      const Bytes frame = ZstdCompressor(3).compress(channel);
      out.push_back(1);
      append_vlq(frame.size(), out);
      out.insert(out.end(), frame.begin(), frame.end());
    } else {
      out.push_back(0);
      out.insert(out.end(), channel.begin(), channel.end());
    }
  }
  return out;
}

inline Bytes constant_stream(uint32_t value, unsigned width) {
  Bytes out{kConstantMode};
  for (unsigned p = 0; p < (width + 7) / 8; ++p) {
    out.push_back(static_cast<unsigned char>(value >> (8 * p)));
  }
  return out;
}

}  // namespace l4d::test
