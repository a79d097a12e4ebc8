// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "libl4dcodec/entropy/stream_kernels.h"
#include "libl4dcodec/base/ordered.h"

namespace l4d {
namespace {

void unpack_bits(const unsigned char* src, size_t src_bytes, size_t n, unsigned width,
                 uint16_t* dst) {
  (void)src_bytes;
  for (size_t i = 0; i < n; ++i) {
    unsigned value = 0;
    for (unsigned b = 0; b < width; ++b) {
      const size_t bit = i * width + b;
      value |= ((unsigned{src[bit / 8]} >> (bit % 8)) & 1u) << b;
    }
    dst[i] = static_cast<uint16_t>(value);
  }
}

void merge_bytes(const unsigned char* low, const unsigned char* high, size_t n, uint16_t* dst) {
  for (size_t i = 0; i < n; ++i) dst[i] = static_cast<uint16_t>(low[i] + 256 * high[i]);
}

void widen_bytes(const unsigned char* src, size_t n, uint16_t* dst) {
  for (size_t i = 0; i < n; ++i) dst[i] = src[i];
}

void undelta(uint16_t* v, size_t n) {
  unsigned previous = 0;
  for (size_t i = 0; i < n; ++i) {
    const unsigned z = v[i];
    previous += (z >> 1) ^ (0u - (z & 1u));
    v[i] = static_cast<uint16_t>(previous);
  }
}

uint16_t unorder_halves(uint16_t* v, size_t n) {
  uint16_t largest = 0;
  for (size_t i = 0; i < n; ++i) {
    v[i] = unorder_half(v[i]);
    largest = std::max(largest, static_cast<uint16_t>(v[i] & 0x7fffu));
  }
  return largest;
}

uint16_t max_value(const uint16_t* v, size_t n) {
  return n == 0 ? uint16_t{0} : *std::max_element(v, v + n);
}

}  // namespace

const StreamKernels& stream_kernels_reference() {
  static constexpr StreamKernels kKernels = {unpack_bits, merge_bytes, widen_bytes, undelta,
                                             unorder_halves, max_value};
  return kKernels;
}

}  // namespace l4d
