// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "libl4dcodec/math/rotor.h"

namespace l4d {

// A 4D Gaussian seen at an instant, the parts of it that do not depend on the instant:
//   mean(t)    = position + velocity (t - t_ref),  position being the mean at t_ref
//   falloff(t) = exp(-lambda (t - mean_t)^2 / 2)
//   covariance = constant
template <typename T>
struct Slice4D {
  T velocity[3];    // scene units per second
  T lambda;         // 1 / temporal variance, 1/s^2
  T covariance[6];  // xx xy xz yy yz zz, scene units^2
};

// Below this temporal variance (s^2) lambda would leave the range of binary32 arithmetic.
constexpr float kMinTemporalVariance = 1e-12f;

template <typename T>
L4D_HOST_DEVICE inline T dot4(const T* a /* [4] */, const T* b /* [4] */) {
  return (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]);
}

// L = R diag(scale) [4, 4], so that L L^T is the covariance in space-time. Rows: m_x, m_y, m_z,
// m_t.
template <typename T>
L4D_HOST_DEVICE inline void scaled_rows(const RotorHalves<T>& halves, const T* scale /* [4] */,
                                        T* rows /* [4, 4] */) {
  rotor_to_matrix(halves, rows);
  for (int i = 0; i < 16; ++i) rows[i] = rows[i] * scale[i & 3];
}

// The textbook subtracts two nearly equal products (Schur complement), which in binary32 destroys
// the covariance of long-lived moving Gaussians. Here each spatial row first loses its part along
// m_t, and the covariance is made of inner products of what remains: positive by construction.
template <typename T>
L4D_HOST_DEVICE inline Slice4D<T> slice_rows(const T* rows /* [4, 4] */) {
  const T* mt = rows + 12;
  const T variance = dot4(mt, mt);
  const T floor = static_cast<T>(kMinTemporalVariance);
  Slice4D<T> slice;
  slice.lambda = static_cast<T>(1) / (variance > floor ? variance : floor);
  T p[3][4];  // spatial rows without their part along m_t
  for (int i = 0; i < 3; ++i) {
    const T* m = rows + 4 * i;
    const T v = dot4(m, mt) * slice.lambda;
    slice.velocity[i] = v;
    for (int k = 0; k < 4; ++k) p[i][k] = m[k] - v * mt[k];
  }
  slice.covariance[0] = dot4(p[0], p[0]);
  slice.covariance[1] = dot4(p[0], p[1]);
  slice.covariance[2] = dot4(p[0], p[2]);
  slice.covariance[3] = dot4(p[1], p[1]);
  slice.covariance[4] = dot4(p[1], p[2]);
  slice.covariance[5] = dot4(p[2], p[2]);
  return slice;
}

// `halves` are normalised, `scale` is the exponential of log_scale.
template <typename T>
L4D_HOST_DEVICE inline Slice4D<T> slice_gaussian(const RotorHalves<T>& halves,
                                                 const T* scale /* [4] */) {
  T rows[16];
  scaled_rows(halves, scale, rows);
  return slice_rows(rows);
}

}  // namespace l4d
