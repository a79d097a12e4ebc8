// SPDX-License-Identifier: Apache-2.0
#include "decoder/expand/reconstruct.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/math/rotor.h"
#include "libl4dcodec/scene/attributes.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

void positions(const uint16_t* const columns[3], size_t n, const float center[3], float scale,
               float* dst) {
  for (size_t i = 0; i < n; ++i) {
    for (size_t axis = 0; axis < 3; ++axis) {
      dst[3 * i + axis] = center[axis] + scale * half_to_float(columns[axis][i]);
    }
  }
}

void means(const uint16_t* halves, size_t n, float width, float* dst) {
  for (size_t i = 0; i < n; ++i) dst[i] = width * half_to_float(halves[i]);
}

void fixed_means(const uint16_t* codes, const uint16_t* fine, size_t n, float step, uint32_t zero,
                 float* dst) {
  for (size_t i = 0; i < n; ++i) {
    dst[i] = fixed_mean_time(step, zero, codes[i], fine == nullptr ? uint16_t{0} : fine[i]);
  }
}

void absolute_means(const float* local, size_t n, double center, float* dst) {
  for (size_t i = 0; i < n; ++i) {
    dst[i] = static_cast<float>(center + static_cast<double>(local[i]));
  }
}

void scalars(const uint16_t* codes, size_t n, float offset, float step, float* dst) {
  for (size_t i = 0; i < n; ++i) dst[i] = offset + step * static_cast<float>(codes[i]);
}

void vq_rows(const VqSource& source, VqCursor& cursor, size_t begin, size_t end, float* dst, bool) {
  for (size_t i = begin; i < end; ++i, dst += source.dim) {
    const size_t depth = source.depth == nullptr ? source.num_stages : source.depth[i];
    if (depth == kEscapeDepth) {
      const uint16_t* row = source.escape + source.dim * cursor.escape++;
      for (size_t k = 0; k < source.dim; ++k) dst[k] = half_to_float(row[k]);
      continue;
    }
    if (depth == 0) {
      for (size_t k = 0; k < source.dim; ++k) dst[k] = 0.0f;
      continue;
    }
    for (size_t s = 0; s < depth; ++s) {
      const float* row = source.codebook[s] + source.dim * source.index[s][cursor.index[s]++];
      for (size_t k = 0; k < source.dim; ++k) dst[k] = s == 0 ? row[k] : dst[k] + row[k];
    }
  }
}

void log_scales(const float* factor, const float* normalized, size_t n, float* dst, bool) {
  for (size_t i = 0; i < n; ++i) {
    for (size_t k = 0; k < 4; ++k) {
      dst[4 * i + k] = clamp_log_scale(factor[i] + normalized[4 * i + k]);
    }
  }
}

void rotors(const float* spatial, const float* temporal, size_t n, float* dst, bool) {
  for (size_t i = 0; i < n; ++i) {
    float rotor[8];
    for (size_t k = 0; k < 4; ++k) {
      rotor[k] = spatial[4 * i + k];
      rotor[4 + k] = temporal[4 * i + k];
    }
    normalize_rotor(rotor, dst + 8 * i);
  }
}

}  // namespace

const ReconstructKernels& reconstruct_kernels_reference() {
  static constexpr ReconstructKernels kKernels = {positions,      means,   fixed_means,
                                                  absolute_means, scalars, vq_rows,
                                                  log_scales,     rotors,  floats_to_halves};
  return kKernels;
}

}  // namespace l4d
