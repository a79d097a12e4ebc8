// SPDX-License-Identifier: Apache-2.0
#include "eval/pair/seen_errors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "libl4dcodec/scene/slice.h"

namespace l4d::eval {
namespace {

using Matrix = std::array<std::array<double, 3>, 3>;

Matrix full(const std::array<double, 6>& c, double added) {
  return {{{c[0] + added, c[1], c[2]}, {c[1], c[3] + added, c[4]}, {c[2], c[4], c[5] + added}}};
}

// Eigenvalues of a symmetric matrix, by rotations that bring its off-diagonal to nothing.
std::array<double, 3> eigenvalues(Matrix m) {
  for (int sweep = 0; sweep < 30; ++sweep) {
    for (size_t p = 0; p < 2; ++p) {
      for (size_t q = p + 1; q < 3; ++q) {
        if (m[p][q] == 0) continue;
        const double theta = (m[q][q] - m[p][p]) / (2 * m[p][q]);
        const double t = (theta < 0 ? -1 : 1) / (std::fabs(theta) + std::hypot(theta, 1.0));
        const double c = 1 / std::hypot(t, 1.0), s = t * c;
        for (size_t k = 0; k < 3; ++k) {
          const double x = m[k][p], y = m[k][q];
          m[k][p] = c * x - s * y;
          m[k][q] = s * x + c * y;
        }
        for (size_t k = 0; k < 3; ++k) {
          const double x = m[p][k], y = m[q][k];
          m[p][k] = c * x - s * y;
          m[q][k] = s * x + c * y;
        }
      }
    }
  }
  return {m[0][0], m[1][1], m[2][2]};
}

double distance(const Motion& a, const Motion& b, double t) {
  const io::Vec3 x = a.at(t), y = b.at(t);
  return std::hypot(x[0] - y[0], x[1] - y[1], x[2] - y[2]);
}

double opacity_at(const Motion& m, double opacity, double t) {
  if (m.lambda == 0) return std::fabs(t - m.mean_t) <= kVisibleSigmas * m.sigma_t ? opacity : 0;
  return opacity * visible_falloff(m.lambda, t - m.mean_t);
}

double infinite_if_nan(double v) {
  return std::isnan(v) ? std::numeric_limits<double>::infinity() : v;
}

}  // namespace

double min_size(const io::Scene& scene) {
  double extent = 0;
  const double begin = scene.timeline.time_begin, end = begin + io::duration(scene.timeline);
  const size_t n = scene.count();
  if (n == 0) return 0;
  std::vector<io::Vec3> at(n);
  for (size_t i = 0; i < n; ++i) {
    const Motion m = motion_of(scene, i);
    at[i] = m.at(std::clamp(m.mean_t, begin, end));
  }
  std::vector<double> axis(n);
  const size_t tail = static_cast<size_t>(0.05 * static_cast<double>(n));
  for (size_t k = 0; k < 3; ++k) {
    for (size_t i = 0; i < n; ++i) axis[i] = at[i][k];
    std::sort(axis.begin(), axis.end());
    extent = std::max(
        extent, std::min(1.25 * (axis[n - 1 - tail] - axis[tail]), axis.back() - axis.front()));
  }
  return extent / 4000;
}

SeenErrors seen_errors(const Motion& a, double opacity_a, const Motion& b, double opacity_b,
                       double begin, double end, double min_size) {
  SeenErrors out;
  const double nearest = std::clamp(a.mean_t, begin, end) - a.mean_t;
  const double half =
      a.lambda == 0 ? kVisibleSigmas * a.sigma_t
                    : std::sqrt(nearest * nearest + 2 * std::log(2.0) * a.sigma_t * a.sigma_t);
  const auto sizes = eigenvalues(full(a.covariance, 0));
  const double largest = std::sqrt(std::max(0.0, *std::max_element(sizes.begin(), sizes.end())));
  const double size = std::max({largest, min_size, 1e-30});
  // Both move in straight lines: they are farthest apart at an end.
  for (const double reach : {-half, half}) {
    const double t = std::clamp(a.mean_t + reach, begin, end);
    out.position = std::max(out.position, infinite_if_nan(distance(a, b, t) / size));
  }
  const double thinnest = std::max(min_size, 1e-6 * size);
  const double added = thinnest * thinnest;
  Matrix difference = full(b.covariance, 0);
  const Matrix original = full(a.covariance, 0);
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) difference[i][j] -= original[i][j];
  }
  auto variances = sizes, others = eigenvalues(full(b.covariance, 0));
  std::sort(variances.begin(), variances.end());
  std::sort(others.begin(), others.end());
  for (size_t k = 0; k < 3; ++k) {
    const double e = (std::max(others[k], 0.0) + added) / (std::max(variances[k], 0.0) + added);
    out.covariance = std::max(out.covariance, infinite_if_nan(std::max(e, 1 / e)));
  }
  for (const double change : eigenvalues(difference)) {
    out.covariance =
        std::max(out.covariance, infinite_if_nan(1 + std::fabs(change) / (variances[2] + added)));
  }
  const double first =
      std::max(begin, std::min(a.mean_t - 4 * a.sigma_t, b.mean_t - 4 * b.sigma_t));
  const double last = std::min(end, std::max(a.mean_t + 4 * a.sigma_t, b.mean_t + 4 * b.sigma_t));
  if (!(first <= last)) return out;
  const auto look = [&](double t) {
    out.opacity = std::max(out.opacity, infinite_if_nan(std::fabs(opacity_at(a, opacity_a, t) -
                                                                  opacity_at(b, opacity_b, t))));
  };
  constexpr int kInstants = 32;
  for (int k = 0; k <= kInstants; ++k) look(first + (last - first) * k / kInstants);
  for (const Motion* m : {&a, &b}) {
    if (std::isinf(m->sigma_t)) continue;
    for (const double z : {-2.0, -1.0, 0.0, 1.0, 2.0}) {
      look(std::clamp(m->mean_t + z * m->sigma_t, begin, end));
    }
  }
  return out;
}

}  // namespace l4d::eval
