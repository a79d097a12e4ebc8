// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <vector>

#include "decoder/expand/transform.h"
#include "libl4dcodec/math/rotor.h"

namespace l4d {
namespace {

// Sums modulo 2^32.
void integer_rows(const TransformSource& source, TransformCursor& cursor, size_t begin, size_t end,
                  float* dst, bool) {
  std::vector<uint32_t> sum(source.dim);
  for (size_t i = begin; i < end; ++i, dst += source.dim) {
    size_t count = source.num_coefficients;
    if (source.eob_index != nullptr) {
      count = source.eob_index[i] == 0 ? 0 : source.eob_table[source.eob_index[i] - 1];
    }
    std::fill(sum.begin(), sum.end(), uint32_t{0});
    for (size_t k = 0; k < count; ++k) {
      const int32_t q = source.coefficient[k][cursor.coefficient[k]++];
      const int16_t* vector = source.integer_basis + source.dim * k;
      for (size_t d = 0; d < source.dim; ++d) sum[d] += static_cast<uint32_t>(q * vector[d]);
    }
    const float scale =
        source.integer_scale * (1.0f / static_cast<float>(1u << source.step_exponent[i]));
    for (size_t d = 0; d < source.dim; ++d) {
      dst[d] = source.basis[d] + static_cast<float>(static_cast<int32_t>(sum[d])) * scale;
    }
  }
}

void rows(const TransformSource& source, TransformCursor& cursor, size_t begin, size_t end,
          float* dst) {
  for (size_t i = begin; i < end; ++i, dst += source.dim) {
    for (size_t d = 0; d < source.dim; ++d) dst[d] = source.basis[d];
    size_t count = source.num_coefficients;
    if (source.eob_index != nullptr) {
      count = source.eob_index[i] == 0 ? 0 : source.eob_table[source.eob_index[i] - 1];
    }
    const float scale = 1.0f / static_cast<float>(1u << source.step_exponent[i]);
    for (size_t k = 0; k < count; ++k) {
      const int16_t q = source.coefficient[k][cursor.coefficient[k]++];
      const float c = (static_cast<float>(q) * scale) * source.steps[k];
      const float* vector = source.basis + source.dim * (k + 1);
      for (size_t d = 0; d < source.dim; ++d) dst[d] = dst[d] + c * vector[d];
    }
  }
}

void rotors(const float* spatial, const float* temporal, size_t n, float* dst, bool) {
  for (size_t i = 0; i < n; ++i) {
    float a[3], b[3];
    for (size_t k = 0; k < 3; ++k) {
      const float u = spatial[3 * i + k];
      const float v = temporal == nullptr ? 0.0f : temporal[3 * i + k];
      a[k] = on_stereographic_grid(u + v);
      b[k] = on_stereographic_grid(u - v);
    }
    RotorHalves<float> halves;
    half_of_stereographic(a, halves.a);
    half_of_stereographic(b, halves.b);
    rotor_of_halves(halves, dst + 8 * i);
  }
}

void positions(const uint32_t* const columns[3], size_t n, const float corner[3], float step,
               float* dst) {
  for (size_t i = 0; i < n; ++i) {
    for (size_t axis = 0; axis < 3; ++axis) {
      dst[3 * i + axis] = corner[axis] + step * static_cast<float>(columns[axis][i]);
    }
  }
}

}  // namespace

const TransformKernels& transform_kernels_reference() {
  static constexpr TransformKernels kKernels = {rows, integer_rows, rotors, positions};
  return kKernels;
}

}  // namespace l4d
