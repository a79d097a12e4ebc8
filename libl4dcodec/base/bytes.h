// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "libl4dcodec/base/span.h"

namespace l4d {

using Bytes = std::vector<unsigned char>;

template <typename T>
T load_le(const unsigned char* p) {
  uint64_t v = 0;
  for (size_t i = 0; i < sizeof(T); ++i) v |= uint64_t{p[i]} << (8 * i);
  return static_cast<T>(v);
}

template <typename T>
void store_le(T value, unsigned char* p) {
  for (size_t i = 0; i < sizeof(T); ++i) {
    p[i] = static_cast<unsigned char>(static_cast<uint64_t>(value) >> (8 * i));
  }
}

template <typename T>
void append_le(T value, Bytes& out) {
  const size_t at = out.size();
  out.resize(at + sizeof(T));
  store_le(value, out.data() + at);
}

// Base-128 integer, least significant group first, high bit = more follow.
inline void append_vlq(uint64_t value, Bytes& out) {
  while (value >= 0x80) {
    out.push_back(static_cast<unsigned char>(value | 0x80));
    value >>= 7;
  }
  out.push_back(static_cast<unsigned char>(value));
}

// Reads a byte range front to back. Reading past the end gives zeros and sets a sticky error, so a
// parser checks once per structure instead of once per field.
class ByteReader {
 public:
  explicit ByteReader(ByteSpan data) : data_(data) {}

  size_t position() const { return position_; }
  size_t remaining() const { return data_.size() - position_; }
  bool failed() const { return failed_; }

  template <typename T>
  T le() {
    const ByteSpan s = take(sizeof(T));
    return s.empty() ? T{0} : load_le<T>(s.data());
  }
  uint64_t vlq() {
    uint64_t value = 0;
    for (unsigned shift = 0; shift < 63; shift += 7) {
      const uint8_t b = le<uint8_t>();
      value |= uint64_t{b & 0x7fu} << shift;
      if ((b & 0x80) == 0) return value;
    }
    failed_ = true;
    return 0;
  }
  // The next n bytes, or an empty span (and the error) where fewer remain.
  ByteSpan take(uint64_t n) {
    if (n > remaining()) {
      failed_ = true;
      position_ = data_.size();
      return {};
    }
    const ByteSpan s = data_.subspan(position_, static_cast<size_t>(n));
    position_ += static_cast<size_t>(n);
    return s;
  }

 private:
  ByteSpan data_;
  size_t position_ = 0;
  bool failed_ = false;
};

}  // namespace l4d
