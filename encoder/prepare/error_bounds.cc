// SPDX-License-Identifier: Apache-2.0
#include "encoder/prepare/error_bounds.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "libl4dcodec/scene/slice.h"

namespace l4d {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Instants at which opacities are compared, beside the mean times.
constexpr int kInstants = 16;
// Thirds that are cut off around a maximum: 2^-14 of what lies between two instants is left, and
// the error is flat there.
constexpr int kClimbs = 24;
// Maxima are looked for where instants show at least this share of what matters.
constexpr double kLookCloser = 0.5;

// Eigenvalues of a symmetric matrix xx xy xz yy yz zz, the largest first. The roots of its cubic
// are off by 1e-8 of the largest where two are close, too much for the variances of a needle: so
// only the root that lies apart is taken from there, and the rest across its axis.
void eigenvalues(const double* m, double* out) {
  const double mean = (m[0] + m[3] + m[5]) / 3;
  const double a = m[0] - mean, b = m[3] - mean, c = m[5] - mean;
  const double off = m[1] * m[1] + m[2] * m[2] + m[4] * m[4];
  const double p = std::sqrt((a * a + b * b + c * c + 2 * off) / 6);
  std::fill_n(out, 3, mean);
  if (!(p > 0)) return;
  const double det =
      a * (b * c - m[4] * m[4]) - m[1] * (m[1] * c - m[4] * m[2]) + m[2] * (m[1] * m[4] - b * m[2]);
  const double turn = std::clamp(det / (2 * p * p * p), -1.0, 1.0);
  constexpr double kThird = 2.0943951023931953;  // of a turn
  const double apart = 2 * p * std::cos(std::acos(turn) / 3 + (turn < 0 ? kThird : 0));
  // Its axis is across all rows of what is left without it.
  const double rows[3][3] = {
      {a - apart, m[1], m[2]}, {m[1], b - apart, m[4]}, {m[2], m[4], c - apart}};
  double axis[3] = {0, 0, 0}, longest = 0;
  for (size_t i = 0; i < 3; ++i) {
    const double *x = rows[i], *y = rows[(i + 1) % 3];
    const double across[3] = {x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2],
                              x[0] * y[1] - x[1] * y[0]};
    const double length2 = across[0] * across[0] + across[1] * across[1] + across[2] * across[2];
    if (length2 > longest) {
      longest = length2;
      std::copy_n(across, 3, axis);
    }
  }
  if (!(longest > 0)) return;
  for (double& x : axis) x /= std::sqrt(longest);
  // Two directions across the axis.
  const size_t k = std::fabs(axis[0]) > std::fabs(axis[1]) ? 0 : 1;
  const double scale = 1 / std::hypot(axis[k], axis[2]);
  double u[3] = {0, 0, axis[k] * scale};
  u[k] = -axis[2] * scale;
  const double w[3] = {axis[1] * u[2] - axis[2] * u[1], axis[2] * u[0] - axis[0] * u[2],
                       axis[0] * u[1] - axis[1] * u[0]};
  const auto along = [&](const double* x, const double* y) {
    return x[0] * (m[0] * y[0] + m[1] * y[1] + m[2] * y[2]) +
           x[1] * (m[1] * y[0] + m[3] * y[1] + m[4] * y[2]) +
           x[2] * (m[2] * y[0] + m[4] * y[1] + m[5] * y[2]);
  };
  const double uu = along(u, u), ww = along(w, w);
  const double half = (uu + ww) / 2, reach = std::hypot((uu - ww) / 2, along(u, w));
  out[0] = along(axis, axis);
  out[1] = half + reach;
  out[2] = half - reach;
  std::sort(out, out + 3, [](double x, double y) { return x > y; });
}

// How far b is from a: the largest ratio of a principal variance of one to that of the other, one
// way or the other; or 1 and the largest change of a variance in any direction, in parts of a's
// largest. The first is about sizes, the second about directions, on the scale of the whole: a thin
// disc that turns a little is little changed.
double variance_factor(const double* a, const double* b, double min_variance) {
  double x[3], y[3], difference[6], changes[3];
  eigenvalues(a, x);
  eigenvalues(b, y);
  double factor = 1;
  for (int k = 0; k < 3; ++k) {
    const double ratio =
        (std::max(y[k], 0.0) + min_variance) / (std::max(x[k], 0.0) + min_variance);
    factor = std::max(factor, ratio > 0 ? std::max(ratio, 1 / ratio) : kInfinity);
  }
  for (int k = 0; k < 6; ++k) difference[k] = b[k] - a[k];
  eigenvalues(difference, changes);
  const double change = std::max(std::fabs(changes[0]), std::fabs(changes[2]));
  return std::max(factor, 1 + change / std::max(x[0] + min_variance, 1e-300));
}

double seen_part(const SeenGaussian& g, double t) { return visible_falloff(g.lambda, t - g.mean); }

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

// The largest value of error(t) near `t`, one of a local maximum of values `step` apart.
template <typename Error>
double climb(const Error& error, double t, double step, double begin, double end) {
  double low = std::max(begin, t - step), high = std::min(end, t + step);
  double largest = 0;
  for (int k = 0; k < kClimbs; ++k) {
    const double x = low + (high - low) / 3, y = high - (high - low) / 3;
    const double at_x = error(x), at_y = error(y);
    largest = std::max({largest, at_x, at_y});
    (at_x < at_y ? low : high) = at_x < at_y ? x : y;
  }
  return largest;
}

// Where that may be more than `interesting`, to the last digits.
double opacity_error(const SeenGaussian& a, const SeenGaussian& b, double begin, double end,
                     double interesting) {
  double first = end, last = begin;
  double gates[4];
  size_t num_gates = 0;
  for (const SeenGaussian* g : {&a, &b}) {
    const double reach = std::sqrt(static_cast<double>(kVisibilityGate) / g->lambda);
    first = std::min(first, std::max(begin, g->mean - reach));
    last = std::max(last, std::min(end, g->mean + reach));
    gates[num_gates++] = g->mean - reach;
    gates[num_gates++] = g->mean + reach;
  }
  if (!(first <= last)) return 0;
  const auto error = [&](double t) {
    return std::fabs(a.opacity * seen_part(a, t) - b.opacity * seen_part(b, t));
  };
  const double step = (last - first) / kInstants;
  double seen[kInstants + 1], worst = 0;
  for (int k = 0; k <= kInstants; ++k) {
    seen[k] = error(first + step * k);
    worst = std::max(worst, seen[k]);
  }
  for (const SeenGaussian* g : {&a, &b}) {
    worst = std::max(worst, error(std::clamp(g->mean, begin, end)));
  }
  if (!(worst > kLookCloser * interesting)) return worst;
  const double sampled = worst;
  const auto look = [&](double t) { worst = std::max(worst, climb(error, t, step, first, last)); };
  for (int k = 0; k <= kInstants; ++k) {
    const bool top =
        (k == 0 || seen[k] >= seen[k - 1]) && (k == kInstants || seen[k] >= seen[k + 1]);
    if (top && seen[k] > kLookCloser * sampled) look(first + step * k);
  }
  for (const SeenGaussian* g : {&a, &b}) look(std::clamp(g->mean, begin, end));
  // One of them is gone just beyond its gate.
  for (const double gate : gates) {
    const double beyond = 1e-9 * (last - first);
    for (const double t : {gate - beyond, gate + beyond}) {
      if (t >= first && t <= last) worst = std::max(worst, error(t));
    }
  }
  return worst;
}

}  // namespace

GaussianErrors errors_of(const SeenGaussian& original, const SeenGaussian& decoded, double begin,
                         double end, const ErrorBounds& bounds, double interesting_opacity) {
  GaussianErrors out;
  const double nearest = std::clamp(original.mean, begin, end) - original.mean;
  // Half of the most opacity: exp(-lambda dt^2 / 2) falls to half of its value at `nearest`.
  const double half = std::sqrt(nearest * nearest + 2 * std::log(2.0) / original.lambda);
  double spread[3];
  eigenvalues(original.covariance, spread);
  const double min_size = std::max(bounds.min_size, original.min_size);
  const double size = std::max(std::sqrt(std::max(spread[0], 0.0)), min_size);
  out.position = (distance_within(original, decoded, half, begin, end) + bounds.position_slack) /
                 std::max(size, 1e-30);
  const double gate = 4 / std::sqrt(original.lambda);
  if (std::fabs(nearest) <= gate) {
    out.visible = distance_within(original, decoded, gate, begin, end) + bounds.position_slack;
  }
  // Nothing is so flat that rounding could make its variance negative.
  const double thinnest = std::max(min_size, 1e-6 * size);
  out.covariance = variance_factor(original.covariance, decoded.covariance, thinnest * thinnest);
  out.opacity =
      opacity_error(original, decoded, begin, end, interesting_opacity) + bounds.opacity_slack;
  // What does not fade has no mean time.
  if (decoded.lambda > 0) {
    out.mean_time = std::fabs(decoded.mean - original.mean) * std::sqrt(original.lambda);
  }
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
