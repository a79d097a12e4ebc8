// SPDX-License-Identifier: Apache-2.0
// Contract of the loops that turn columns into float attributes (spec: "Reconstruction").
// Exactness class B: binary32 + - * / sqrt in the order written here, no contraction; every
// implementation gives the same bits for every input a stream can hold.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "l4d/l4d.h"

namespace l4d {

// A vector-quantised component of one page.
struct VqSource {
  size_t dim = 0;
  size_t num_stages = 0;
  std::array<const float*, L4D_MAX_STAGES> codebook{};  // [entries, dim], CodebookData padding
  std::array<const uint16_t*, L4D_MAX_STAGES> index{};  // compact: Gaussians with depth > s
  const uint8_t* depth = nullptr;                       // [n], or null: num_stages for all
  const uint16_t* escape = nullptr;                     // [num_escapes, dim] binary16
};

// Where the next Gaussian's entries lie in the compact arrays.
struct VqCursor {
  std::array<size_t, L4D_MAX_STAGES> index{};
  size_t escape = 0;
};

// `past_cache`: dst is larger than the cache and not read again soon, so it may be written around
// it.
struct ReconstructKernels {
  // dst[i] = center + scale * half, [n, 3] from three columns of binary16.
  void (*positions)(const uint16_t* const columns[3], size_t n, const float center[3], float scale,
                    float* dst);
  // dst[i] = width * half.
  void (*means)(const uint16_t* halves, size_t n, float width, float* dst);
  // dst[i] = fixed_mean_time(step, zero, codes[i], fine[i]); fine null: zeros.
  void (*fixed_means)(const uint16_t* codes, const uint16_t* fine, size_t n, float step,
                      uint32_t zero, float* dst);
  // dst[i] = binary32(center + binary64(local[i])).
  void (*absolute_means)(const float* local, size_t n, double center, float* dst);
  // dst[i] = offset + step * code.
  void (*scalars)(const uint16_t* codes, size_t n, float offset, float step, float* dst);
  // Rows i = begin..end-1 of the page to dst [end - begin, dim]: the escape, or the codewords of
  // all stages below the depth summed in order of stages (zeros at depth 0). Rows are taken in
  // order: the cursor carries the place from one call to the next.
  void (*vq_rows)(const VqSource& source, VqCursor& cursor, size_t begin, size_t end, float* dst,
                  bool past_cache);
  // dst[i, k] = factor[i] + normalized[i, k], clamped (clamp_log_scale), [n, 4].
  void (*log_scales)(const float* factor, const float* normalized, size_t n, float* dst,
                     bool past_cache);
  // dst[i] = normalised rotor of spatial[i] (s b01 b02 b12) and temporal[i] (b03 b13 b23 p), [n,
  // 8].
  void (*rotors)(const float* spatial, const float* temporal, size_t n, float* dst,
                 bool past_cache);
  // dst[i] = the binary16 number nearest to from[i] (floats_to_halves, base/half.h).
  void (*halves)(const float* from, size_t n, uint16_t* dst);
};

// Scalar loops in the words of the specification.
const ReconstructKernels& reconstruct_kernels_reference();
// The widest SIMD target of this machine.
const ReconstructKernels& reconstruct_kernels_simd();

}  // namespace l4d
