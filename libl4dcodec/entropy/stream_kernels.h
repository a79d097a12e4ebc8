// SPDX-License-Identifier: Apache-2.0
// Contract of the inner loops that turn stored stream bytes into integers (spec: "Streams").
// Exactness class A: every implementation gives the same integers for every input.
#pragma once

#include <cstddef>
#include <cstdint>

namespace l4d {

struct StreamKernels {
  // dst[i] = bits [i * width, (i + 1) * width) of src, least significant bit first. width 1..16.
  // src_bytes >= ceil(n * width / 8); nothing past src + src_bytes is read.
  void (*unpack_bits)(const unsigned char* src, size_t src_bytes, size_t n, unsigned width,
                      uint16_t* dst);
  // dst[i] = low[i] + 256 * high[i].
  void (*merge_bytes)(const unsigned char* low, const unsigned char* high, size_t n, uint16_t* dst);
  // dst[i] = src[i].
  void (*widen_bytes)(const unsigned char* src, size_t n, uint16_t* dst);
  // In place: v[i] = v[i - 1] + unzigzag(v[i]) mod 2^16, v[-1] = 0.
  void (*undelta)(uint16_t* v, size_t n);
  // In place: ordered integers to binary16 bits. Returns the largest value of bits & 0x7fff, which
  // is below 0x7c00 if and only if all are finite.
  uint16_t (*unorder_halves)(uint16_t* v, size_t n);
  // Largest value, 0 for n = 0.
  uint16_t (*max_value)(const uint16_t* v, size_t n);

  // Bit b of columns[k][i] = bit 3 b + k of codes[i], all of which are below 2^63.
  void (*split_morton)(const uint64_t* codes, size_t n, uint32_t* const columns[3]);
  // values[i] = unzigzag(codes[i]); magnitudes[i] = |values[i]|, but at most 15.
  void (*unzigzag)(const uint16_t* codes, size_t n, int16_t* values, uint8_t* magnitudes);
  // contexts[i] = 5 step_exponent[i] + (how many of 0, 2, 6 and 14 are below last[i] + before[i]).
  // step_exponent, last and before hold at most 15.
  void (*coefficient_contexts)(const uint8_t* step_exponent, const uint8_t* last,
                               const uint8_t* before, size_t n, uint8_t* contexts);
  // dst[i] = map[src[i]]; dst may be src. src is below `entries`, at most 128; map is readable up
  // to a multiple of 16.
  void (*map_bytes)(const uint8_t* map, size_t entries, const uint8_t* src, size_t n, uint8_t* dst);
  // Of each of the arrays [n], in place, leaves the elements i where arrays[0][i] is above `limit`,
  // in order, and returns their number. What lies behind them, up to n, is undefined. Numbers in
  // arrays[0], and the limit, are below 128.
  size_t (*keep_above)(uint8_t* const* arrays, size_t num_arrays, size_t n, uint8_t limit);
};

// Scalar loops in the words of the specification.
const StreamKernels& stream_kernels_reference();
// The widest SIMD target of this machine.
const StreamKernels& stream_kernels_simd();

}  // namespace l4d
