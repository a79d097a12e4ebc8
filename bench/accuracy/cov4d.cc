// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/cov4d.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "io/scene/rotor_math.h"

namespace l4d::bench {
namespace {

constexpr size_t kDim = 10;
// Training points per codeword.
constexpr size_t kSample = 32;

using Matrix = Eigen::Matrix4d;
using Point = std::array<float, kDim>;

io::Rotor rotor_of(const io::Scene& s, size_t i) {
  io::Rotor r;
  for (size_t k = 0; k < 8; ++k) r[k] = static_cast<double>(s.rotor[8 * i + k]);
  return r;
}

// log of the square root of the covariance's trace.
double log_factor(const io::Scene& s, size_t i) {
  const float* l = s.log_scale.data() + 4 * i;
  const double top = static_cast<double>(*std::max_element(l, l + 4));
  double sum = 0;
  for (size_t k = 0; k < 4; ++k) sum += std::exp(2 * (static_cast<double>(l[k]) - top));
  return top + 0.5 * std::log(sum);
}

Point normalised_covariance(const io::Scene& s, size_t i) {
  const io::Matrix4 r = io::rotor_to_matrix(rotor_of(s, i));
  const double factor = log_factor(s, i);
  Matrix rows;
  for (int a = 0; a < 4; ++a) {
    for (int b = 0; b < 4; ++b) {
      rows(a, b) =
          r[static_cast<size_t>(4 * a + b)] *
          std::exp(static_cast<double>(s.log_scale[4 * i + static_cast<size_t>(b)]) - factor);
    }
  }
  const Matrix c = rows * rows.transpose();
  Point p;
  size_t k = 0;
  for (int a = 0; a < 4; ++a) {
    for (int b = a; b < 4; ++b) p[k++] = static_cast<float>(c(a, b));
  }
  return p;
}

// Codewords by coordinate, so that the search runs over codewords.
struct Codebook {
  size_t size;
  std::array<std::vector<float>, kDim> values;

  size_t nearest(const Point& p, std::vector<float>& distance) const {
    std::fill(distance.begin(), distance.end(), 0.0f);
    for (size_t d = 0; d < kDim; ++d) {
      const float x = p[d];
      const float* c = values[d].data();
      for (size_t k = 0; k < size; ++k) distance[k] += (x - c[k]) * (x - c[k]);
    }
    return static_cast<size_t>(std::min_element(distance.begin(), distance.end()) -
                               distance.begin());
  }
};

Codebook train(const std::vector<Point>& points, const std::vector<float>& weights, size_t size,
               int iterations) {
  std::mt19937_64 random(1);
  std::vector<size_t> sample(points.size());
  for (size_t i = 0; i < sample.size(); ++i) sample[i] = i;
  std::shuffle(sample.begin(), sample.end(), random);
  sample.resize(std::min(sample.size(), size * kSample));
  Codebook codebook;
  codebook.size = std::min(size, sample.size());
  for (size_t d = 0; d < kDim; ++d) {
    for (size_t k = 0; k < codebook.size; ++k) codebook.values[d].push_back(points[sample[k]][d]);
  }
  std::vector<float> distance(codebook.size);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    std::vector<double> mass(codebook.size), sum(kDim * codebook.size);
    for (const size_t i : sample) {
      const size_t k = codebook.nearest(points[i], distance);
      const double w = static_cast<double>(weights[i]);
      mass[k] += w;
      for (size_t d = 0; d < kDim; ++d) {
        sum[kDim * k + d] += w * static_cast<double>(points[i][d]);
      }
    }
    for (size_t k = 0; k < codebook.size; ++k) {
      if (!(mass[k] > 0)) continue;
      for (size_t d = 0; d < kDim; ++d) {
        codebook.values[d][k] = static_cast<float>(sum[kDim * k + d] / mass[k]);
      }
    }
  }
  return codebook;
}

struct Shape {
  io::Rotor rotor;
  std::array<double, 4> log_scale;
};

// Axes are eigenvectors, the most time-like of them last.
Shape shape_of(const Codebook& codebook, size_t k) {
  Matrix c;
  size_t d = 0;
  for (int a = 0; a < 4; ++a) {
    for (int b = a; b < 4; ++b, ++d) c(a, b) = c(b, a) = static_cast<double>(codebook.values[d][k]);
  }
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(c);
  Matrix axes = solver.eigenvectors();
  Eigen::Vector4d variance = solver.eigenvalues();
  Eigen::Index last = 0;
  axes.row(3).cwiseAbs().maxCoeff(&last);
  axes.col(last).swap(axes.col(3));
  std::swap(variance(last), variance(3));
  if (axes.determinant() < 0) axes.col(0) = -axes.col(0);
  io::Matrix4 m;
  Shape shape{};
  for (int a = 0; a < 4; ++a) {
    for (int b = 0; b < 4; ++b) m[static_cast<size_t>(4 * a + b)] = axes(a, b);
    // Rounding leaves eigenvalues at and below zero: they become the smallest that binary32 sums
    // keep.
    const double least = static_cast<double>(std::numeric_limits<float>::epsilon()) * 1e-3;
    shape.log_scale[static_cast<size_t>(a)] = 0.5 * std::log(std::max(variance(a), least));
  }
  shape.rotor = io::matrix_to_rotor(m);
  return shape;
}

}  // namespace

Cov4d quantise_covariances(io::Scene& s, const std::vector<float>& weights, size_t num_codewords,
                           int iterations) {
  const size_t n = s.count();
  std::vector<Point> points(n);
  for (size_t i = 0; i < n; ++i) points[i] = normalised_covariance(s, i);
  const Codebook codebook = train(points, weights, num_codewords, iterations);
  std::vector<Shape> shapes(codebook.size);
  for (size_t k = 0; k < codebook.size; ++k) shapes[k] = shape_of(codebook, k);
  std::vector<float> distance(codebook.size);
  std::vector<size_t> uses(codebook.size);
  for (size_t i = 0; i < n; ++i) {
    const size_t k = codebook.nearest(points[i], distance);
    ++uses[k];
    const double factor = log_factor(s, i);
    for (size_t j = 0; j < 4; ++j) {
      // The range of log scales that the library takes.
      s.log_scale[4 * i + j] =
          static_cast<float>(std::clamp(shapes[k].log_scale[j] + factor, -16.0, 16.0));
    }
    for (size_t j = 0; j < 8; ++j) s.rotor[8 * i + j] = static_cast<float>(shapes[k].rotor[j]);
  }
  Cov4d result;
  result.codebook_bytes = static_cast<double>(2 * kDim * codebook.size);
  for (const size_t count : uses) {
    if (count == 0) continue;
    const double x = static_cast<double>(count);
    result.index_bits += x * std::log2(static_cast<double>(n) / x);
  }
  return result;
}

}  // namespace l4d::bench
