// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/worst.h"

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
  // Largest variance of the slice, by power iteration: the matrix is positive semi-definite.
  double largest_variance() const {
    double c[3][3];
    for (size_t i = 0; i < 3; ++i) {
      for (size_t j = 0; j < 3; ++j) {
        c[i][j] = 0;
        for (size_t k = 0; k < 4; ++k) c[i][j] += slice.rows[i][k] * slice.rows[j][k];
      }
    }
    io::Vec3 v = {1, 0.9, 0.8};
    double value = 0;
    for (int step = 0; step < 40; ++step) {
      io::Vec3 w{};
      for (size_t i = 0; i < 3; ++i) {
        for (size_t j = 0; j < 3; ++j) w[i] += c[i][j] * v[j];
      }
      value = std::sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
      if (!(value > 0)) return 0;
      for (size_t i = 0; i < 3; ++i) v[i] = w[i] / value;
    }
    return value;
  }
};

double opacity_of(const io::Scene& s, size_t i) {
  const double value = static_cast<double>(s.opacity[i]);
  return (s.flags & L4D_OPACITY_LOGIT) != 0 ? 1 / (1 + std::exp(-value)) : value;
}

// Diagonal of the box that holds 98 % of the positions on each axis: a few far Gaussians do not
// make a scene large.
double extent(const io::Scene& s) {
  double squares = 0;
  std::vector<float> axis(s.count());
  for (size_t k = 0; k < 3; ++k) {
    for (size_t i = 0; i < s.count(); ++i) axis[i] = s.position[3 * i + k];
    std::sort(axis.begin(), axis.end());
    const double low = static_cast<double>(axis[axis.size() / 100]);
    const double high = static_cast<double>(axis[axis.size() - 1 - axis.size() / 100]);
    squares += (high - low) * (high - low);
  }
  return std::sqrt(squares);
}

// Falloff of a half: exp(-x^2 / 2) = 1/2.
constexpr double kHalf = 1.1774100225154747;

}  // namespace

WorstGaussian worst_gaussian(const io::Scene& original, const Encoded& encoded) {
  const io::Scene decoded = decode(encoded.file);
  const double least = extent(original) / 4000;
  const double begin = original.timeline.time_begin;
  const double end = begin + io::duration(original.timeline);
  WorstGaussian worst;
  for (size_t i = 0; i < decoded.count(); ++i) {
    const size_t source = encoded.order[i];
    const Path a(original, source), b(decoded, i);
    const double from = std::max(begin, a.mean_t - kHalf * a.slice.sigma_t);
    const double to = std::min(end, a.mean_t + kHalf * a.slice.sigma_t);
    if (!(from <= to)) continue;
    const double variance = a.largest_variance();
    const double unit = std::max(std::sqrt(variance), least);
    // Both move on straight lines, so that the distance is largest at an end.
    for (const double t : {from, to}) {
      double squares = 0;
      for (size_t k = 0; k < 3; ++k) squares += std::pow(a.at(t, k) - b.at(t, k), 2);
      worst.position = std::max(worst.position, std::sqrt(squares) / unit);
    }
    worst.mean_time = std::max(worst.mean_time, std::fabs(a.mean_t - b.mean_t) / a.slice.sigma_t);
    const double ratio = b.largest_variance() / std::max(variance, 1e-300);
    worst.covariance = std::max({worst.covariance, ratio, 1 / std::max(ratio, 1e-300)});
    worst.opacity =
        std::max(worst.opacity, std::fabs(opacity_of(original, source) - opacity_of(decoded, i)));
  }
  return worst;
}

}  // namespace l4d::bench
