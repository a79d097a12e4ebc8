// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/worst.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "io/rotor_math.h"

namespace l4d::bench {
namespace {

// One Gaussian in double precision, so that comparing two adds no error of its own.
struct Path {
  io::Slice slice;
  io::Vec3 position;  // at `anchor`
  double anchor = 0;
  double mean_t = 0;

  Path(const io::Scene& s, size_t i) {
    io::Rotor rotor;
    io::Vec4 scale;
    for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(s.rotor[8 * i + k]);
    for (size_t k = 0; k < 4; ++k) {
      scale[k] = std::exp(static_cast<double>(s.log_scale[4 * i + k]));
    }
    slice = io::slice(rotor, scale);
    for (size_t k = 0; k < 3; ++k) position[k] = static_cast<double>(s.position[3 * i + k]);
    mean_t = static_cast<double>(s.mean_t[i]);
    const double begin = s.timeline.time_begin;
    anchor = (s.flags & L4D_POSITION_AT_MEAN_TIME) != 0
                 ? mean_t
                 : std::clamp(mean_t, begin, begin + io::duration(s.timeline));
  }
  double at(double t, size_t axis) const {
    return position[axis] + slice.velocity[axis] * (t - anchor);
  }
  // Principal variances of the slice, the smallest first.
  Eigen::Vector3d variances() const {
    Eigen::Matrix3d c;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        double sum = 0;
        for (size_t k = 0; k < 4; ++k) {
          sum += slice.rows[static_cast<size_t>(i)][k] * slice.rows[static_cast<size_t>(j)][k];
        }
        c(i, j) = sum;
      }
    }
    return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(c, Eigen::EigenvaluesOnly).eigenvalues();
  }
};

double opacity_of(const io::Scene& s, size_t i) {
  const double value = static_cast<double>(s.opacity[i]);
  return (s.flags & L4D_OPACITY_LOGIT) != 0 ? 1 / (1 + std::exp(-value)) : value;
}

// Size below which nothing counts as smaller (docs/numerics.md): 1/4000 of the extent, which is the
// largest side of the box of nine tenths of all Gaussians on each axis, and a quarter more.
double least_size(const io::Scene& s) {
  double side = 0;
  std::vector<float> axis(s.count());
  for (size_t k = 0; k < 3; ++k) {
    for (size_t i = 0; i < s.count(); ++i) axis[i] = s.position[3 * i + k];
    std::sort(axis.begin(), axis.end());
    const size_t tail = axis.size() / 20;
    side = std::max(
        side, static_cast<double>(axis[axis.size() - 1 - tail]) - static_cast<double>(axis[tail]));
  }
  return 1.25 * side / 4000;
}

// Opacity at t, gone beyond four temporal standard deviations.
double seen_opacity(double opacity, const Path& g, double t) {
  const double x = (t - g.mean_t) / g.slice.sigma_t;
  return std::fabs(x) <= 4 ? opacity * std::exp(-0.5 * x * x) : 0;
}

// Largest difference of opacities at any of the instants.
double opacity_error(double opacity_a, const Path& a, double opacity_b, const Path& b, double begin,
                     double end) {
  constexpr int kInstants = 64;
  const double reach = 4 * std::max(a.slice.sigma_t, b.slice.sigma_t);
  const double from = std::max(begin, std::min(a.mean_t, b.mean_t) - reach);
  const double to = std::min(end, std::max(a.mean_t, b.mean_t) + reach);
  if (!(from <= to)) return 0;
  double worst = 0;
  for (int k = 0; k <= kInstants; ++k) {
    const double t = from + (to - from) * k / kInstants;
    worst =
        std::max(worst, std::fabs(seen_opacity(opacity_a, a, t) - seen_opacity(opacity_b, b, t)));
  }
  return worst;
}

}  // namespace

WorstGaussian worst_gaussian(const io::Scene& original, const Encoded& encoded) {
  const io::Scene decoded = decode(encoded.file);
  const double least = least_size(original);
  const double begin = original.timeline.time_begin;
  const double end = begin + io::duration(original.timeline);
  WorstGaussian worst;
  for (size_t i = 0; i < decoded.count(); ++i) {
    const size_t source = encoded.order[i];
    const Path a(original, source), b(decoded, i);
    const double nearest = std::clamp(a.mean_t, begin, end) - a.mean_t;
    // exp(-x^2 / 2) falls to half of what it is at `nearest`.
    const double half =
        std::sqrt(nearest * nearest + 2 * std::log(2.0) * a.slice.sigma_t * a.slice.sigma_t);
    const Eigen::Vector3d variances_a = a.variances(), variances_b = b.variances();
    const double unit = std::max(std::sqrt(variances_a[2]), least);
    // Both move on straight lines, so that the distance is largest at an end.
    for (const double t : {a.mean_t - half, a.mean_t + half}) {
      double squares = 0;
      for (size_t k = 0; k < 3; ++k) {
        const double at = std::clamp(t, begin, end);
        squares += std::pow(a.at(at, k) - b.at(at, k), 2);
      }
      worst.position = std::max(worst.position, std::sqrt(squares) / unit);
    }
    worst.mean_time = std::max(worst.mean_time, std::fabs(a.mean_t - b.mean_t) / a.slice.sigma_t);
    for (int k = 0; k < 3; ++k) {
      const double ratio = (variances_b[k] + least * least) / (variances_a[k] + least * least);
      worst.covariance = std::max({worst.covariance, ratio, 1 / ratio});
    }
    worst.opacity = std::max(worst.opacity, opacity_error(opacity_of(original, source), a,
                                                          opacity_of(decoded, i), b, begin, end));
  }
  return worst;
}

}  // namespace l4d::bench
