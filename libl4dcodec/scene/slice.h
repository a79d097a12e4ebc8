// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "libl4dcodec/math/rotor.h"

// What a 4D Gaussian looks like at an instant: the formulas, each written once for all who slice,
// on any side and in any precision.
namespace l4d {

// A Gaussian is visible while lambda (t - mean)^2 is at most this: 4 temporal standard deviations.
constexpr float kVisibilityGate = 16.0f;
constexpr double kVisibleSigmas = 4;

// `dt` is t - mean_t. NaN is not visible.
template <typename T>
L4D_HOST_DEVICE inline bool is_visible(T lambda, T dt, float gate = kVisibilityGate) {
  return lambda * (dt * dt) <= static_cast<T>(gate);
}

// The part of its opacity that a Gaussian has `dt` from its mean time.
template <typename T>
L4D_HOST_DEVICE inline T falloff(T lambda, T dt) {
  return std::exp(static_cast<T>(-0.5) * (lambda * (dt * dt)));
}

// The same, gone where the Gaussian is not visible.
template <typename T>
L4D_HOST_DEVICE inline T visible_falloff(T lambda, T dt) {
  return is_visible(lambda, dt) ? falloff(lambda, dt) : static_cast<T>(0);
}

// Opacity in [0, 1] of one that is stored as it is or as a logit.
template <typename T>
L4D_HOST_DEVICE inline T linear_opacity(T stored, bool logit) {
  return logit ? static_cast<T>(1) / (static_cast<T>(1) + std::exp(-stored)) : stored;
}

// A 4D Gaussian seen at an instant, the parts of it that do not depend on the instant:
//   mean(t)    = position + velocity (t - t_ref),  position being the mean at t_ref
//   opacity(t) = opacity falloff(lambda, t - mean_t)
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
// `p`: the spatial rows without their part along m_t, the covariance is p p^T.
template <typename T>
L4D_HOST_DEVICE inline Slice4D<T> slice_rows(const T* rows /* [4, 4] */, T (*p)[4] /* [3, 4] */) {
  const T* mt = rows + 12;
  const T variance = dot4(mt, mt);
  const T floor = static_cast<T>(kMinTemporalVariance);
  Slice4D<T> slice;
  slice.lambda = static_cast<T>(1) / (variance > floor ? variance : floor);
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

template <typename T>
L4D_HOST_DEVICE inline Slice4D<T> slice_rows(const T* rows /* [4, 4] */) {
  T p[3][4];
  return slice_rows(rows, p);
}

// `halves` are normalised, `scale` is the exponential of log_scale. `p`: as in slice_rows.
template <typename T>
L4D_HOST_DEVICE inline Slice4D<T> slice_gaussian(const RotorHalves<T>& halves,
                                                 const T* scale /* [4] */, T (*p)[4] /* [3, 4] */) {
  T rows[16];
  scaled_rows(halves, scale, rows);
  return slice_rows(rows, p);
}

template <typename T>
L4D_HOST_DEVICE inline Slice4D<T> slice_gaussian(const RotorHalves<T>& halves,
                                                 const T* scale /* [4] */) {
  T p[3][4];
  return slice_gaussian(halves, scale, p);
}

// From stored attributes, worked out in T. `p`: as in slice_rows.
template <typename T, typename Stored>
L4D_HOST_DEVICE inline Slice4D<T> slice_attributes(const Stored* rotor /* [8], of any length */,
                                                   const Stored* log_scale /* [4] */,
                                                   T (*p)[4] /* [3, 4] */) {
  T r[8], scale[4];
  for (int k = 0; k < 8; ++k) r[k] = static_cast<T>(rotor[k]);
  for (int k = 0; k < 4; ++k) scale[k] = std::exp(static_cast<T>(log_scale[k]));
  return slice_gaussian(normalized_halves(r), scale, p);
}

template <typename T, typename Stored>
L4D_HOST_DEVICE inline Slice4D<T> slice_attributes(const Stored* rotor /* [8] */,
                                                   const Stored* log_scale /* [4] */) {
  T p[3][4];
  return slice_attributes(rotor, log_scale, p);
}

}  // namespace l4d
