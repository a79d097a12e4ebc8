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
  // In place: ordered integers to binary16 bits. Returns the largest value of bits & 0x7fff, which is
  // below 0x7c00 if and only if all are finite.
  uint16_t (*unorder_halves)(uint16_t* v, size_t n);
  // Largest value, 0 for n = 0.
  uint16_t (*max_value)(const uint16_t* v, size_t n);
};

// Scalar loops in the words of the specification.
const StreamKernels& stream_kernels_reference();
// The widest SIMD target of this machine.
const StreamKernels& stream_kernels_simd();

}  // namespace l4d
