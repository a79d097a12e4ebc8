// SPDX-License-Identifier: Apache-2.0
// Contract of the loops that turn transform coefficients and fixed-point positions into floats
// (spec: "Decoding process"). Exactness class B, as reconstruct.h.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace l4d {

// A transform-coded component of one page.
struct TransformSource {
  size_t dim = 0;
  size_t num_coefficients = 0;
  const float* basis =
      nullptr;  // [num_coefficients + 1, dim], the origin first; CodebookData padding
  const float* steps = nullptr;  // [num_coefficients]
  // Of integer_rows (quant/integer_basis.h): [num_coefficients, dim], and the power of two that
  // sums are multiplied by. These rows take only the origin of `basis`, and no steps.
  const int16_t* integer_basis = nullptr;
  float integer_scale = 0;
  const uint8_t* step_exponent = nullptr;  // [n], below 16
  const uint8_t* eob_index =
      nullptr;  // [n], at most the number of steps of the EOB table; null: all of them
  const uint8_t* eob_table = nullptr;
  // Compact: Gaussians whose EOB index reaches it. integer_rows reads up to
  // kCoefficientPadding (container/page.h) more numbers, and uses them for nothing.
  std::array<const int16_t*, 48> coefficient{};
};

// Where the next Gaussian's coefficients lie in the compact arrays.
struct TransformCursor {
  std::array<size_t, 48> coefficient{};
};

struct TransformKernels {
  // Rows i = begin..end-1 of the page to dst [end - begin, dim]. With c_k = (q_k *
  // 2^-step_exponent) * step_k, a row is the origin, to which c_k times basis vector k is added for
  // k = 0, 1, .. below what the Gaussian's EOB index has. Rows are taken in order: the cursor
  // carries the place.
  void (*rows)(const TransformSource& source, TransformCursor& cursor, size_t begin, size_t end,
               float* dst);
  // The same of integers: with m_k the vectors of integer_basis, a row is the origin +
  // (binary32(sum of q_k * m_k modulo 2^32, as a signed number) * (integer_scale *
  // 2^-step_exponent)).
  void (*integer_rows)(const TransformSource& source, TransformCursor& cursor, size_t begin,
                       size_t end, float* dst, bool past_cache);
  // dst[i] = rotor [8] of the halves whose stereographic coordinates are spatial[i] + temporal[i]
  // and spatial[i] - temporal[i], each [3], put on their grid (on_stereographic_grid). temporal
  // null = zeros.
  void (*rotors)(const float* spatial, const float* temporal, size_t n, float* dst,
                 bool past_cache);
  // dst[i] = corner + step * code, [n, 3] from three columns of integers below 2^21.
  void (*positions)(const uint32_t* const columns[3], size_t n, const float corner[3], float step,
                    float* dst);
};

// Scalar loops in the words of the specification.
const TransformKernels& transform_kernels_reference();
// The widest SIMD target of this machine.
const TransformKernels& transform_kernels_simd();

}  // namespace l4d
