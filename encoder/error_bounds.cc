// SPDX-License-Identifier: Apache-2.0
#include "encoder/error_bounds.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Instants at which opacities are compared, beside the mean times.
constexpr int kInstants = 16;

// Eigenvalues of a symmetric matrix xx xy xz yy yz zz, the largest first.
void eigenvalues(const double* m, double* out) {
  const double mean = (m[0] + m[3] + m[5]) / 3;
  const double a = m[0] - mean, b = m[3] - mean, c = m[5] - mean;
  const double off = m[1] * m[1] + m[2] * m[2] + m[4] * m[4];
  const double p = std::sqrt((a * a + b * b + c * c + 2 * off) / 6);
  if (!(p > 0)) {
    std::fill_n(out, 3, mean);
    return;
  }
  const double det =
      a * (b * c - m[4] * m[4]) - m[1] * (m[1] * c - m[4] * m[2]) + m[2] * (m[1] * m[4] - b * m[2]);
  const double angle = std::acos(std::clamp(det / (2 * p * p * p), -1.0, 1.0)) / 3;
  constexpr double kThird = 2.0943951023931953;  // of a turn
  out[0] = mean + 2 * p * std::cos(angle);
  out[2] = mean + 2 * p * std::cos(angle + kThird);
  out[1] = 3 * mean - out[0] - out[2];
}

// How far b is from a: the largest ratio of a principal variance of one to that of the other, one
// way or the other; or 1 and the largest change of a variance in any direction, in parts of a's
// largest. The first is about sizes, the second about directions, on the scale of the whole: a thin
// disc that turns a little is little changed.
double variance_factor(const double* a, const double* b, double least_variance) {
  double x[3], y[3], difference[6], changes[3];
  eigenvalues(a, x);
  eigenvalues(b, y);
  double factor = 1;
  for (int k = 0; k < 3; ++k) {
    const double ratio =
        (std::max(y[k], 0.0) + least_variance) / (std::max(x[k], 0.0) + least_variance);
    factor = std::max(factor, ratio > 0 ? std::max(ratio, 1 / ratio) : kInfinity);
  }
  for (int k = 0; k < 6; ++k) difference[k] = b[k] - a[k];
  eigenvalues(difference, changes);
  const double change = std::max(std::fabs(changes[0]), std::fabs(changes[2]));
  return std::max(factor, 1 + change / std::max(x[0] + least_variance, 1e-300));
}

double falloff(const SeenGaussian& g, double t) {
  const double dt = t - g.mean;
  const double exponent = g.lambda * dt * dt;
  return exponent <= static_cast<double>(kVisibilityGate) ? std::exp(-0.5 * exponent) : 0;
}

double distance_at(const SeenGaussian& a, const SeenGaussian& b, double t) {
  double sum = 0;
  for (int k = 0; k < 3; ++k) {
    const double d = (a.position[k] + a.velocity[k] * (t - a.reference)) -
                     (b.position[k] + b.velocity[k] * (t - b.reference));
    sum += d * d;
  }
  return std::sqrt(sum);
}

// Largest distance within `reach` of the mean time and the sequence: at one end of that, since both
// move in straight lines.
double distance_within(const SeenGaussian& a, const SeenGaussian& b, double reach, double begin,
                       double end) {
  return std::max(distance_at(a, b, std::clamp(a.mean - reach, begin, end)),
                  distance_at(a, b, std::clamp(a.mean + reach, begin, end)));
}

double opacity_error(const SeenGaussian& a, const SeenGaussian& b, double begin, double end) {
  double first = end, last = begin;
  for (const SeenGaussian* g : {&a, &b}) {
    const double reach = std::sqrt(static_cast<double>(kVisibilityGate) / g->lambda);
    first = std::min(first, std::max(begin, g->mean - reach));
    last = std::max(last, std::min(end, g->mean + reach));
  }
  if (!(first <= last)) return 0;
  double worst = 0;
  const auto look = [&](double t) {
    worst = std::max(worst, std::fabs(a.opacity * falloff(a, t) - b.opacity * falloff(b, t)));
  };
  for (int k = 0; k <= kInstants; ++k) look(first + (last - first) * k / kInstants);
  look(std::clamp(a.mean, begin, end));
  look(std::clamp(b.mean, begin, end));
  return worst;
}

}  // namespace

GaussianErrors errors_of(const SeenGaussian& original, const SeenGaussian& decoded, double begin,
                         double end, const ErrorBounds& bounds) {
  GaussianErrors out;
  const double nearest = std::clamp(original.mean, begin, end) - original.mean;
  // Half of the most opacity: exp(-lambda dt^2 / 2) falls to half of its value at `nearest`.
  const double half = std::sqrt(nearest * nearest + 2 * std::log(2.0) / original.lambda);
  double spread[3];
  eigenvalues(original.covariance, spread);
  const double size = std::max(std::sqrt(std::max(spread[0], 0.0)), bounds.least_size);
  out.position = (distance_within(original, decoded, half, begin, end) + bounds.position_slack) /
                 std::max(size, 1e-30);
  const double gate = 4 / std::sqrt(original.lambda);
  if (std::fabs(nearest) <= gate) {
    out.visible = distance_within(original, decoded, gate, begin, end) + bounds.position_slack;
  }
  // Nothing is so flat that rounding could make its variance negative.
  const double thinnest = std::max(bounds.least_size, 1e-6 * size);
  out.covariance = variance_factor(original.covariance, decoded.covariance, thinnest * thinnest);
  out.opacity = opacity_error(original, decoded, begin, end) + bounds.opacity_slack;
  return out;
}

double excess_of(const GaussianErrors& errors, const ErrorBounds& bounds) {
  const auto part = [](double error, double bound) {
    if (!(bound > 0)) return 0.0;
    return std::isnan(error) ? kInfinity : error / bound;
  };
  // Of a factor, what is beyond 1 counts.
  return std::max({part(errors.position, bounds.position),
                   bounds.covariance > 1 ? part(errors.covariance - 1, bounds.covariance - 1) : 0.0,
                   part(errors.opacity, bounds.opacity), part(errors.visible, bounds.visible)});
}

}  // namespace l4d
