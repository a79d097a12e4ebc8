// SPDX-License-Identifier: Apache-2.0
#include "io/scene/rotor_math.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "libl4dcodec/scene/shape.h"

namespace l4d::io {
namespace {

// Columns of a matrix as vectors.
using Columns = std::array<Vec4, 4>;

double dot(const Vec4& a, const Vec4& b) {
  return (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]);
}

bool normalize(Vec4& v) {
  const double norm2 = dot(v, v);
  if (!(norm2 >= 1e-300)) return false;
  const double norm = std::sqrt(norm2);
  for (double& x : v) x /= norm;
  return true;
}

void normalize_or_identity(Vec4& quaternion) {
  if (!normalize(quaternion)) quaternion = {1, 0, 0, 0};
}

// Makes the columns orthogonal: then they are the left singular vectors times the singular values.
void orthogonalize(Columns& columns) {
  static_assert(sizeof(Columns) == 16 * sizeof(double));
  l4d::orthogonalize<4>(columns[0].data(), [](int, int, double, double) {});
}

double determinant(const Columns& m) {
  const auto minor3 = [&](size_t i, size_t j, size_t k) {  // rows x y z of three columns
    const Vec4 &a = m[i], &b = m[j], &c = m[k];
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
  };
  return m[3][3] * minor3(0, 1, 2) - m[2][3] * minor3(0, 1, 3) + m[1][3] * minor3(0, 2, 3) -
         m[0][3] * minor3(1, 2, 3);
}

}  // namespace

Matrix4 rotor_to_matrix(const Rotor& r) {
  Matrix4 matrix;
  l4d::rotor_to_matrix(normalized_halves(r.data()), matrix.data());
  return matrix;
}

Rotor matrix_to_rotor(const Matrix4& m) {
  // The sixteen sign patterns above are mutually orthogonal, so projecting on them gives back the
  // products k[i][j] = a[i] b[j] (times four), a matrix of rank 1.
  Columns k;  // rows of that matrix
  k[0] = {m[0] + m[5] + m[10] + m[15], m[1] - m[4] + m[11] - m[14], m[2] - m[7] - m[8] + m[13],
          m[3] + m[6] - m[9] - m[12]};
  k[1] = {m[1] - m[4] - m[11] + m[14], m[10] + m[15] - m[0] - m[5], -m[3] - m[6] - m[9] - m[12],
          m[2] - m[7] + m[8] - m[13]};
  k[2] = {m[2] + m[7] - m[8] - m[13], m[3] - m[6] - m[9] + m[12], m[5] - m[0] - m[10] + m[15],
          -m[1] - m[4] - m[11] - m[14]};
  k[3] = {-m[3] + m[6] - m[9] + m[12], m[2] + m[7] + m[8] + m[13], -m[1] - m[4] + m[11] + m[14],
          m[0] - m[5] - m[10] + m[15]};
  size_t longest = 0;
  for (size_t i = 1; i < 4; ++i) {
    if (dot(k[i], k[i]) > dot(k[longest], k[longest])) longest = i;
  }
  Vec4 b = k[longest];
  normalize_or_identity(b);
  Vec4 a{dot(k[0], b), dot(k[1], b), dot(k[2], b), dot(k[3], b)};
  normalize_or_identity(a);
  Rotor r{a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3],
          b[3] - a[3], a[2] - b[2], b[1] - a[1], a[0] - b[0]};
  const double half = r[0] < 0 ? -0.5 : 0.5;
  for (double& x : r) x *= half;
  return r;
}

Rotor quaternion_to_rotor(const Vec4& wxyz) {
  Vec4 q = wxyz;
  normalize_or_identity(q);
  // `0.0 -` rather than unary minus: the identity should not hold negative zeros.
  return {q[0], 0.0 - q[3], q[2], 0.0 - q[1], 0, 0, 0, 0};
}

Matrix3 quaternion_to_matrix(const Vec4& wxyz) {
  const Matrix4 m = rotor_to_matrix(quaternion_to_rotor(wxyz));
  return {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
}

Vec4 matrix_to_quaternion(const Matrix3& m) {
  const Rotor r =
      matrix_to_rotor({m[0], m[1], m[2], 0, m[3], m[4], m[5], 0, m[6], m[7], m[8], 0, 0, 0, 0, 1});
  Vec4 q{r[0], -r[3], r[2], -r[1]};
  normalize_or_identity(q);
  return q;
}

Slice slice(const Rotor& rotor, const Vec4& scale) {
  double rows[16], projected[3][4];
  scaled_rows(normalized_halves(rotor.data()), scale.data(), rows);
  const Slice4D<double> s = slice_rows(rows, projected);
  Slice out;
  std::copy_n(s.velocity, 3, out.velocity.begin());
  for (size_t i = 0; i < 3; ++i) std::copy_n(projected[i], 4, out.rows[i].begin());
  out.sigma_t = std::sqrt(dot4(rows + 12, rows + 12));
  return out;
}

Vec3 velocity_of(const Rotor& rotor, const Vec4& scale) {
  if (rotor[4] == 0 && rotor[5] == 0 && rotor[6] == 0 && rotor[7] == 0) return {0, 0, 0};
  return slice(rotor, scale).velocity;
}

Shape4 shape_of_moving(const Matrix3& rotation, const Vec3& scale, const Vec3& velocity,
                       double sigma_t) {
  Columns u;  // the factor [[R S, v sigma_t], [0, sigma_t]]
  for (size_t k = 0; k < 3; ++k) {
    u[k] = {rotation[k] * scale[k], rotation[3 + k] * scale[k], rotation[6 + k] * scale[k], 0};
    u[3][k] = velocity[k] * sigma_t;
  }
  u[3][3] = sigma_t;
  orthogonalize(u);

  Vec4 sigma;
  for (size_t k = 0; k < 4; ++k) {
    sigma[k] = std::sqrt(dot(u[k], u[k]));
    normalize(u[k]);
  }
  size_t time_axis = 0;
  for (size_t k = 1; k < 4; ++k) {
    if (std::abs(u[k][3]) > std::abs(u[time_axis][3])) time_axis = k;
  }
  std::swap(u[time_axis], u[3]);
  std::swap(sigma[time_axis], sigma[3]);
  if (u[3][3] < 0) {
    for (double& x : u[3]) x = 0.0 - x;
  }

  // Six orders of the other three axes; per order the best signs are those of the diagonal, unless
  // their product makes a reflection: then the weakest one gives way.
  constexpr size_t kOrders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2},
                                    {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
  const double det = determinant(u);
  Columns best = u;
  Vec4 best_sigma = sigma;
  double best_match = -1e300;
  for (size_t o = 0; o < 6; ++o) {
    const bool odd = o == 1 || o == 2 || o == 5;
    double match = 0, weakest = 1e300;
    bool reflects = (det < 0) != odd;
    size_t weakest_axis = 0;
    Vec3 sign;
    for (size_t k = 0; k < 3; ++k) {
      const Vec4& axis = u[kOrders[o][k]];
      const double c =
          axis[0] * rotation[k] + axis[1] * rotation[3 + k] + axis[2] * rotation[6 + k];
      sign[k] = c < 0 ? -1 : 1;
      reflects ^= c < 0;
      match += std::abs(c);
      if (std::abs(c) < weakest) {
        weakest = std::abs(c);
        weakest_axis = k;
      }
    }
    if (reflects) {
      match -= 2 * weakest;
      sign[weakest_axis] = -sign[weakest_axis];
    }
    if (match <= best_match) continue;
    best_match = match;
    for (size_t k = 0; k < 3; ++k) {
      best_sigma[k] = sigma[kOrders[o][k]];
      for (size_t i = 0; i < 4; ++i) best[k][i] = sign[k] * u[kOrders[o][k]][i];
    }
  }
  best[3] = u[3];
  best_sigma[3] = sigma[3];

  Shape4 out;
  out.scale = best_sigma;
  Matrix4 matrix;
  for (size_t i = 0; i < 4; ++i) {
    for (size_t k = 0; k < 4; ++k) matrix[4 * i + k] = best[k][i];
  }
  out.rotor = matrix_to_rotor(matrix);
  return out;
}

}  // namespace l4d::io
