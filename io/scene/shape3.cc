// SPDX-License-Identifier: Apache-2.0
#include "io/scene/shape3.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace l4d::io {
namespace {

Shape3 shape_of(const Eigen::Matrix3d& axes, const Eigen::Vector3d& scale) {
  Eigen::Matrix3d rotation = axes;
  if (rotation.determinant() < 0) rotation.col(2) = -rotation.col(2);
  Matrix3 matrix;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) matrix[static_cast<size_t>(3 * r + c)] = rotation(r, c);
  }
  return {matrix_to_quaternion(matrix), {scale[0], scale[1], scale[2]}};
}

}  // namespace

Shape3 shape_of_rows(const std::array<Vec4, 3>& rows) {
  Eigen::Matrix<double, 3, 4> m;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) m(r, c) = rows[static_cast<size_t>(r)][static_cast<size_t>(c)];
  }
  const Eigen::JacobiSVD<Eigen::Matrix<double, 3, 4>> svd(
      m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return shape_of(svd.matrixU(), svd.singularValues());
}

Shape3 shape_of_covariance(const float* c /* [6] */) {
  Eigen::Matrix3d m;
  m << static_cast<double>(c[0]), static_cast<double>(c[1]), static_cast<double>(c[2]),
      static_cast<double>(c[1]), static_cast<double>(c[3]), static_cast<double>(c[4]),
      static_cast<double>(c[2]), static_cast<double>(c[4]), static_cast<double>(c[5]);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m);
  // Below its rounding in float32 the covariance says nothing about its thin axes; the eigenvalues
  // there are noise of either sign. The second bound keeps a point from having log scale -inf.
  const double largest = std::max(solver.eigenvalues()[2], 0.0);
  const double least = std::max(std::ldexp(largest, -24), 1e-20);
  return shape_of(solver.eigenvectors(), solver.eigenvalues().cwiseMax(least).cwiseSqrt());
}

}  // namespace l4d::io
