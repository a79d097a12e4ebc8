// SPDX-License-Identifier: Apache-2.0
#include "encoder/search/principal_axes.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "libl4dcodec/base/threads.h"

namespace l4d {

PrincipalAxes find_principal_axes(const float* rows, size_t n, size_t dim) {
  // Seven rows per entry of the covariance of SH: the axes only decide speed.
  constexpr size_t kMaxRows = 8192;
  const size_t step = std::max<size_t>(1, (n + kMaxRows - 1) / kMaxRows);
  const double count = static_cast<double>((n + step - 1) / step);
  std::vector<double> mean(dim, 0.0);
  for (size_t r = 0; r < n; r += step) {
    for (size_t j = 0; j < dim; ++j) mean[j] += static_cast<double>(rows[r * dim + j]);
  }
  for (double& m : mean) m /= count;

  const Eigen::Index size = static_cast<Eigen::Index>(dim);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
  std::vector<double> centred(dim);
  for (size_t r = 0; r < n; r += step) {
    for (size_t j = 0; j < dim; ++j) {
      centred[j] = static_cast<double>(rows[r * dim + j]) - mean[j];
    }
    for (size_t a = 0; a < dim; ++a) {  // the lower triangle is all the solver reads
      double* column = covariance.data() + a * dim;
      for (size_t b = a; b < dim; ++b) column[b] += centred[a] * centred[b];
    }
  }

  PrincipalAxes axes;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance);
  if (solver.info() != Eigen::Success || !solver.eigenvectors().allFinite()) return axes;
  axes.stride = (dim + 15) / 16 * 16;
  axes.mean.resize(dim);
  axes.basis.assign(dim * axes.stride, 0.0f);
  for (size_t d = 0; d < dim; ++d) {
    axes.mean[d] = static_cast<float>(mean[d]);
    for (size_t j = 0; j < dim; ++j) {  // eigenvalues come in ascending order
      axes.basis[d * axes.stride + j] = static_cast<float>(solver.eigenvectors()(
          static_cast<Eigen::Index>(d), static_cast<Eigen::Index>(dim - 1 - j)));
    }
  }
  return axes;
}

void rotate_to_axes(const PrincipalAxes& axes, const float* rows, size_t n, size_t dim, int threads,
                    float* out) {
  constexpr size_t kFewPoints = 1024;
  parallel_for(threads, n, kFewPoints, [&](size_t begin, size_t end) {
    std::vector<float> sum(axes.stride);
    for (size_t i = begin; i < end; ++i) {
      std::fill(sum.begin(), sum.end(), 0.0f);
      for (size_t d = 0; d < dim; ++d) {
        const float centred = rows[i * dim + d] - axes.mean[d];
        const float* axis = axes.basis.data() + d * axes.stride;
        for (size_t j = 0; j < axes.stride; ++j) sum[j] += centred * axis[j];
      }
      std::copy_n(sum.begin(), dim, out + i * dim);
    }
  });
}

}  // namespace l4d
