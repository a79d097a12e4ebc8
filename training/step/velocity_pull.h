// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>

#include "libl4dcodec/scene/slice.h"

// The derivative of how far a row's velocity is from that of its neighbours, on the host and on
// devices (the 4D consistency of Duan et al. 2024).
namespace l4d::train {

// Adds to `gradient` what pulls on the four numbers of half (a or b) before it has length 1.
L4D_HOST_DEVICE inline void add_half_gradient(const float* raw, const float* unit,
                                              const float* by_unit, float* by_raw) {
  float norm2 = 0, along = 0;
  for (int k = 0; k < 4; ++k) {
    norm2 += raw[k] * raw[k];
    along += by_unit[k] * unit[k];
  }
  if (norm2 < kMinHalfNorm2) return;
  const float length = std::sqrt(norm2);
  for (int k = 0; k < 4; ++k) by_raw[k] = (by_unit[k] - along * unit[k]) / length;
}

// Adds the derivatives of weight |v - motion|_1 by rotor [8], of any length, and log_scale [4],
// with the velocity v = sum_k m_k m_t,k / |m_t|^2 of the rows m of L = R diag(exp(log_scale)).
L4D_HOST_DEVICE inline void add_velocity_pull(const float* rotor, const float* log_scale,
                                              const float* motion, float weight,
                                              float* rotor_gradient, float* scale_gradient) {
  const RotorHalves<float> raw = halves_of_rotor(rotor);
  const RotorHalves<float> h = normalized_halves(rotor);
  float scale[4], rows[16], by_row[16];
  for (int k = 0; k < 4; ++k) scale[k] = std::exp(log_scale[k]);
  scaled_rows(h, scale, rows);
  const Slice4D<float> slice = slice_rows(rows);
  const float* mt = rows + 12;
  float pull[3], along = 0;
  for (int i = 0; i < 3; ++i) {
    const float d = slice.velocity[i] - motion[i];
    pull[i] = d > 0 ? weight : d < 0 ? -weight : 0;
    along += pull[i] * slice.velocity[i];
  }
  for (int k = 0; k < 4; ++k) {
    float sum = -2 * along * mt[k];
    for (int i = 0; i < 3; ++i) {
      by_row[4 * i + k] = pull[i] * slice.lambda * mt[k];
      sum += pull[i] * rows[4 * i + k];
    }
    by_row[12 + k] = slice.lambda * sum;
  }
  for (int k = 0; k < 4; ++k) {
    for (int i = 0; i < 4; ++i) scale_gradient[k] += by_row[4 * i + k] * rows[4 * i + k];
  }
  for (int i = 0; i < 16; ++i) by_row[i] *= scale[i & 3];
  // The matrix is linear in each half.
  RotorHalves<float> by_unit, by_raw{};
  for (int k = 0; k < 4; ++k) {
    RotorHalves<float> a = h, b = h;
    for (int j = 0; j < 4; ++j) a.a[j] = b.b[j] = j == k ? 1.0f : 0.0f;
    float matrix[16];
    const auto product = [&] {
      float sum = 0;
      for (int i = 0; i < 16; ++i) sum += by_row[i] * matrix[i];
      return sum;
    };
    rotor_to_matrix(a, matrix);
    by_unit.a[k] = product();
    rotor_to_matrix(b, matrix);
    by_unit.b[k] = product();
  }
  add_half_gradient(raw.a, h.a, by_unit.a, by_raw.a);
  add_half_gradient(raw.b, h.b, by_unit.b, by_raw.b);
  // halves_of_rotor is half its own inverse's transpose: its columns have two ones each.
  float by_rotor[8];
  rotor_of_halves(by_raw, by_rotor);
  for (int k = 0; k < 8; ++k) rotor_gradient[k] += 2 * by_rotor[k];
}

}  // namespace l4d::train
