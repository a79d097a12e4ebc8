// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

namespace l4d::io {

// Rotor mathematics of the importers and exporters, in double precision. Everything but
// log_scale -> scale uses + - * / sqrt only, so results are the same bits on every machine.

using Vec3 = std::array<double, 3>;

inline double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
using Vec4 = std::array<double, 4>;
using Rotor = std::array<double, 8>;     // s b01 b02 b12 b03 b13 b23 p
using Matrix3 = std::array<double, 9>;   // row-major
using Matrix4 = std::array<double, 16>;  // row-major; row = world axis x y z t, column = local axis

inline Matrix3 product(const Matrix3& a, const Matrix3& b) {
  Matrix3 out{};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) {
      for (size_t k = 0; k < 3; ++k) out[3 * i + j] += a[3 * i + k] * b[3 * k + j];
    }
  }
  return out;
}
inline Vec3 product(const Matrix3& a, const Vec3& v) {
  Vec3 out{};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t k = 0; k < 3; ++k) out[i] += a[3 * i + k] * v[k];
  }
  return out;
}

// Rotation of a rotor of any length: each of its two quaternion halves is normalised, which makes
// it the nearest valid one. A half of length zero counts as the identity.
Matrix4 rotor_to_matrix(const Rotor& rotor);
// Of the two rotors of a rotation the one with s >= 0. The matrix is orthogonal, determinant +1.
Rotor matrix_to_rotor(const Matrix4& matrix);

// Rotation of space alone; `wxyz` of any length, zero counts as the identity.
Rotor quaternion_to_rotor(const Vec4& wxyz);
Matrix3 quaternion_to_matrix(const Vec4& wxyz);
Vec4 matrix_to_quaternion(const Matrix3& matrix);  // w >= 0

// A 4D Gaussian at an instant, as Slice4D.
struct Slice {
  Vec3 velocity;
  double sigma_t;  // seconds
  std::array<Vec4, 3>
      rows;  // of rotation * scale, less their part along time: covariance = rows rows^T
};
// `scale`: standard deviations along the local axes x y z t.
Slice slice(const Rotor& rotor, const Vec4& scale);
// Only its velocity: what importers and position conversions need most.
Vec3 velocity_of(const Rotor& rotor, const Vec4& scale);

struct Shape4 {
  Rotor rotor;
  Vec4 scale;  // standard deviations
};
// The 4D Gaussian whose slice is the 3D Gaussian (rotation, scale) moving with `velocity` and
// fading with `sigma_t` (> 0): exact. Of the 192 ways to name its axes, the one nearest to the
// arguments: the most time-like axis last, the others nearest to the columns of `rotation`.
Shape4 shape_of_moving(const Matrix3& rotation, const Vec3& scale, const Vec3& velocity,
                       double sigma_t);

}  // namespace l4d::io
