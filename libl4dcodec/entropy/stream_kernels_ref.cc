// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/entropy/stream_kernels.h"

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

void split_morton(const uint64_t* codes, size_t n, uint32_t* const columns[3]) {
  for (size_t i = 0; i < n; ++i) {
    for (unsigned k = 0; k < 3; ++k) {
      uint32_t coordinate = 0;
      for (unsigned b = 0; b < 21; ++b) {
        coordinate |= static_cast<uint32_t>(codes[i] >> (3 * b + k) & 1u) << b;
      }
      columns[k][i] = coordinate;
    }
  }
}

void unzigzag(const uint16_t* codes, size_t n, int16_t* values, uint8_t* magnitudes) {
  for (size_t i = 0; i < n; ++i) {
    const int half = codes[i] >> 1;
    const int value = codes[i] % 2 == 0 ? half : -half - 1;
    values[i] = static_cast<int16_t>(value);
    magnitudes[i] = static_cast<uint8_t>(std::min(value < 0 ? -value : value, 15));
  }
}

void coefficient_contexts(const uint8_t* step_exponent, const uint8_t* last, const uint8_t* before,
                          size_t n, uint8_t* contexts) {
  for (size_t i = 0; i < n; ++i) {
    const int sum = last[i] + before[i];
    contexts[i] =
        static_cast<uint8_t>(5 * step_exponent[i] + (sum > 0) + (sum > 2) + (sum > 6) + (sum > 14));
  }
}

void map_bytes(const uint8_t* map, size_t entries, const uint8_t* src, size_t n, uint8_t* dst) {
  (void)entries;
  for (size_t i = 0; i < n; ++i) dst[i] = map[src[i]];
}

size_t keep_above(uint8_t* const* arrays, size_t num_arrays, size_t n, uint8_t limit) {
  size_t to = 0;
  for (size_t i = 0; i < n; ++i) {
    if (arrays[0][i] <= limit) continue;
    for (size_t a = 0; a < num_arrays; ++a) arrays[a][to] = arrays[a][i];
    ++to;
  }
  return to;
}

}  // namespace

const StreamKernels& stream_kernels_reference() {
  static constexpr StreamKernels kKernels = {
      unpack_bits,  merge_bytes, widen_bytes,          undelta,   unorder_halves, max_value,
      split_morton, unzigzag,    coefficient_contexts, map_bytes, keep_above};
  return kKernels;
}

}  // namespace l4d
