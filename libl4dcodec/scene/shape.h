// SPDX-License-Identifier: Apache-2.0
// The axes of a Gaussian: standard deviations and a rotation instead of a covariance. Only
// + - * / sqrt in a fixed order, so the results are the same bits on every machine.
#pragma once

#include <cmath>
#include <utility>

#include "libl4dcodec/scene/slice.h"

namespace l4d {

// Row a becomes c a - s b, row b becomes s a + c b.
inline void rotate_pair(double* a, double* b, int n, double c, double s) {
  for (int k = 0; k < n; ++k) {
    const double x = a[k], y = b[k];
    a[k] = c * x - s * y;
    b[k] = s * x + c * y;
  }
}

// Rotates pairs of rows until all of them are orthogonal (Jacobi's method, one-sided): the sum of
// their outer products stays. Rows stay accurate however small they are next to others (1e-5 scene
// units and 1e5 seconds), because the scale of a row changes no rounding. turn(p, q, c, s) is
// called for each rotation, of rows p and q as in rotate_pair.
template <int kRows, typename Turn>
inline void orthogonalize(double* rows /* [kRows, 4] */, const Turn& turn) {
  constexpr int kMaxSweeps = 40;        // it converges quadratically; 5 or 6 are usual
  constexpr double kTolerance = 1e-15;  // a few roundings of the dot product
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    bool rotated = false;
    for (int p = 0; p + 1 < kRows; ++p) {
      for (int q = p + 1; q < kRows; ++q) {
        double* a = rows + 4 * p;
        double* b = rows + 4 * q;
        const double aa = dot4(a, a), bb = dot4(b, b), ab = dot4(a, b);
        if (std::abs(ab) <= kTolerance * (std::sqrt(aa) * std::sqrt(bb))) continue;
        rotated = true;
        const double zeta = (bb - aa) / (2 * ab);
        const double root = std::abs(zeta) + std::sqrt(1 + zeta * zeta);
        const double t = (zeta >= 0 ? 1 : -1) / root;
        const double c = 1 / std::sqrt(1 + t * t);
        const double s = c * t;
        rotate_pair(a, b, 4, c, s);
        turn(p, q, c, s);
      }
    }
    if (!rotated) return;
  }
}

// Standard deviations, largest first, and the unit quaternion w x y z that takes the axes of the
// Gaussian to those of space: covariance = R diag(scale)^2 R^T. w is no smaller than |x|, |y| and
// |z|, which fixes the signs of the axes.
struct Shape3 {
  double scale[3];
  double rotation[4];
};

// The quaternion of a rotation matrix whose columns may change signs in pairs: that turns the
// quaternion by i, j or k, so that its largest component can be w.
inline void quaternion_of_axes(const double (*axis)[3] /* [3, 3], axis k is column k */,
                               double* q /* [4] */) {
  const double m00 = axis[0][0], m11 = axis[1][1], m22 = axis[2][2];
  // Four times the square of each component.
  const double square[4] = {1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22,
                            1 - m00 - m11 + m22};
  int largest = 0;
  for (int k = 1; k < 4; ++k) {
    if (square[k] > square[largest]) largest = k;
  }
  // Columns other than `largest` - 1 change their signs, so that w takes its place.
  double m[3][3];
  for (int k = 0; k < 3; ++k) {
    const double sign = largest == 0 || k == largest - 1 ? 1 : -1;
    for (int i = 0; i < 3; ++i) m[i][k] = sign * axis[k][i];
  }
  q[0] = square[largest];
  q[1] = m[2][1] - m[1][2];
  q[2] = m[0][2] - m[2][0];
  q[3] = m[1][0] - m[0][1];
  const double norm = std::sqrt(dot4(q, q));
  for (int k = 0; k < 4; ++k) q[k] = norm > 0 ? q[k] / norm : (k == 0 ? 1 : 0);
}

// Of the covariance rows rows^T. Axes of equal length, and axes of length 0, are as the rows have
// them: any choice would do, and this one is the same on every machine.
inline Shape3 shape_of_rows(const double* rows /* [3, 4] */) {
  double r[12];
  for (int k = 0; k < 12; ++k) r[k] = rows[k];
  double axis[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  orthogonalize<3>(
      r, [&](int p, int q, double c, double s) { rotate_pair(axis[p], axis[q], 3, c, s); });
  double norm2[3];
  for (int k = 0; k < 3; ++k) norm2[k] = dot4(r + 4 * k, r + 4 * k);
  const auto exchange = [&](int p, int q) {
    if (!(norm2[q] > norm2[p])) return;
    std::swap(norm2[p], norm2[q]);
    for (int i = 0; i < 3; ++i) {  // a quarter turn: no reflection
      const double before = axis[p][i];
      axis[p][i] = axis[q][i];
      axis[q][i] = -before;
    }
  };
  exchange(0, 1);
  exchange(1, 2);
  exchange(0, 1);
  Shape3 shape;
  for (int k = 0; k < 3; ++k) shape.scale[k] = std::sqrt(norm2[k]);
  quaternion_of_axes(axis, shape.rotation);
  return shape;
}

}  // namespace l4d
