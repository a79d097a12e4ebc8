// SPDX-License-Identifier: Apache-2.0
#include "io/ply/spacetime.h"

#include <algorithm>
#include <cmath>

#include "io/ply/read_ply.h"
#include "io/scene/counted.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

constexpr int kSamples = 64;  // of the visible span, midpoints

double weight(double dt, double sigma) { return falloff(1 / (sigma * sigma), dt); }

// What the fit of a straight line needs to know of the visible span, in normalised time from the
// centre: the best line a + b dt for dt^2 and for dt^3 under the Gaussian falloff.
struct Span {
  bool visible = false;
  double begin = 0, end = 0;
  double mean = 0;  // weighted
  double a2 = 0, b2 = 0, a3 = 0, b3 = 0;

  double sample(int k) const { return begin + (end - begin) * ((k + 0.5) / kSamples); }
};

Span fit_span(double center, double sigma) {
  Span span;
  span.begin = std::max(-4 * sigma, -center);
  span.end = std::min(4 * sigma, 1 - center);
  span.visible = span.begin < span.end;
  if (!span.visible) {  // the moments of the whole Gaussian
    span.a2 = sigma * sigma;
    span.b3 = 3 * sigma * sigma;
    return span;
  }
  double moment[5] = {0, 0, 0, 0, 0};
  const double unit = std::max(-span.begin, span.end);  // keeps the moments near 1
  for (int k = 0; k < kSamples; ++k) {
    const double dt = span.sample(k);
    double term = weight(dt, sigma);
    for (double& m : moment) {
      m += term;
      term *= dt / unit;
    }
  }
  const double m0 = moment[0], m1 = moment[1], m2 = moment[2], m3 = moment[3], m4 = moment[4];
  const double det = m0 * m2 - m1 * m1;
  span.mean = m1 / m0 * unit;
  if (!(det > 0)) return span;
  span.a2 = (m2 * m2 - m1 * m3) / det * unit * unit;
  span.b2 = (m0 * m3 - m1 * m2) / det * unit;
  span.a3 = (m3 * m2 - m1 * m4) / det * unit * unit * unit;
  span.b3 = (m0 * m4 - m1 * m3) / det * unit * unit;
  return span;
}

// Errors of one kind of approximation, over all Gaussians it touched.
struct ErrorTally {
  size_t count = 0;
  double max = 0, sum_of_means = 0;

  void add(double largest, double mean) {
    ++count;
    max = std::max(max, largest);
    sum_of_means += mean;
  }
  double mean() const { return count > 0 ? sum_of_means / static_cast<double>(count) : 0; }
};

void tally_motion(const Span& span, double sigma, const double* quadratic, const double* cubic,
                  ErrorTally& tally) {
  double largest = 0, sum = 0, weights = 0;
  for (int k = 0; k < kSamples; ++k) {
    const double dt = span.sample(k);
    double error2 = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double e = quadratic[axis] * (dt * dt - span.a2 - span.b2 * dt) +
                       cubic[axis] * (dt * dt * dt - span.a3 - span.b3 * dt);
      error2 += e * e;
    }
    largest = std::max(largest, std::sqrt(error2));
    sum += weight(dt, sigma) * std::sqrt(error2);
    weights += weight(dt, sigma);
  }
  tally.add(largest, weights > 0 ? sum / weights : 0);
}

Vec4 normalized(Vec4 q) {
  const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(norm > 0)) return {1, 0, 0, 0};
  for (double& x : q) x /= norm;
  return q;
}

double angle_between(const Vec4& unit_a, const Vec4& unit_b) {
  double near2 = 0, far2 = 0;  // |a - b|^2 and |a + b|^2: exact for small angles, unlike acos
  for (size_t k = 0; k < 4; ++k) {
    near2 += (unit_a[k] - unit_b[k]) * (unit_a[k] - unit_b[k]);
    far2 += (unit_a[k] + unit_b[k]) * (unit_a[k] + unit_b[k]);
  }
  return 4 * std::atan2(std::sqrt(std::min(near2, far2)), std::sqrt(std::max(near2, far2)));
}

void note_approximations(const ErrorTally& motion, const ErrorTally& turning, double largest_angle,
                         Scene& scene) {
  char text[240];
  if (motion.count > 0) {
    std::snprintf(text, sizeof(text),
                  "%s along curves; straight lines in their place are off by at "
                  "most %.3g and on average %.3g scene units while visible.",
                  counted(motion.count, "Gaussian moves", "Gaussians move").c_str(), motion.max,
                  motion.mean());
    scene.notes.push_back(text);
  }
  if (turning.count > 0) {
    std::snprintf(text, sizeof(text),
                  "%s; their orientation was frozen. It is off by at most %.3g "
                  "degrees, which displaces their surface by at most %.3g and on average %.3g "
                  "scene units while visible.",
                  counted(turning.count, "Gaussian turns", "Gaussians turn").c_str(),
                  largest_angle * 57.29577951308232, turning.max, turning.mean());
    scene.notes.push_back(text);
  }
}

// What the approximation of motion by a line, and of turning by one orientation, costs.
struct StgErrors {
  ErrorTally motion, turning;
  double largest_angle = 0;
};

// One Gaussian, in double.
struct StgGaussian {
  double motion[9];
  Vec4 q, omega;
  Vec3 scale;
  double t, sigma;  // in units of the sequence

  StgGaussian(const SpacetimeRows& rows, const float* log_scale /* [4] */, size_t i) {
    for (size_t k = 0; k < 9; ++k) motion[k] = static_cast<double>(rows.motion[9 * i + k]);
    for (size_t k = 0; k < 4; ++k) {
      q[k] = static_cast<double>(rows.quaternion[4 * i + k]);
      omega[k] = static_cast<double>(rows.turning_rate[4 * i + k]);
    }
    for (size_t k = 0; k < 3; ++k) scale[k] = std::exp(static_cast<double>(log_scale[k]));
    t = static_cast<double>(rows.center[i]);
    sigma = std::exp(static_cast<double>(rows.log_width[i])) / kWidthOfSigma;
  }
  bool is_valid() const {
    return all_finite(motion, 9) && all_finite(q.data(), 4) && all_finite(omega.data(), 4) &&
           all_finite(scale.data(), 3) && all_finite(&t, 1) && all_finite(&sigma, 1) && sigma > 0;
  }
  bool is_curved() const {
    return std::any_of(motion + 3, motion + 9, [](double x) { return x != 0; });
  }
  bool turns() const {
    return std::any_of(omega.begin(), omega.end(), [](double x) { return x != 0; });
  }
  Vec4 orientation(double dt) const {
    Vec4 turned = q;
    for (size_t k = 0; k < 4; ++k) turned[k] += dt * omega[k];
    return normalized(turned);
  }
};

// The orientation that stands for all of them.
Vec4 freeze_orientation(const StgGaussian& g, const Span& span, StgErrors* errors) {
  const Vec4 frozen = g.orientation(span.mean);
  if (!span.visible) return frozen;
  const double reach = *std::max_element(g.scale.begin(), g.scale.end());
  double largest = 0, sum = 0, weights = 0;
  for (int k = 0; k < kSamples; ++k) {
    const double dt = span.sample(k);
    const double angle = angle_between(frozen, g.orientation(dt));
    largest = std::max(largest, angle);
    sum += weight(dt, g.sigma) * angle;
    weights += weight(dt, g.sigma);
  }
  errors->largest_angle = std::max(errors->largest_angle, largest);
  errors->turning.add(largest * reach, weights > 0 ? sum / weights * reach : 0);
  return frozen;
}

// Shape and motion of Gaussian i. unit: seconds.
void store_gaussian(Scene& scene, size_t i, const StgGaussian& g, double unit, StgErrors* errors) {
  const double* m = g.motion;
  Vec4 q = g.q;
  Vec3 velocity{m[0], m[1], m[2]};
  const bool curved = g.is_curved(), turns = g.turns();
  if (curved || turns) {
    const Span span = fit_span(g.t, g.sigma);
    if (curved) {
      for (size_t k = 0; k < 3; ++k) {
        velocity[k] += m[3 + k] * span.b2 + m[6 + k] * span.b3;
        scene.position[3 * i + k] =
            static_cast<float>(static_cast<double>(scene.position[3 * i + k]) + m[3 + k] * span.a2 +
                               m[6 + k] * span.a3);
      }
      if (span.visible) tally_motion(span, g.sigma, m + 3, m + 6, errors->motion);
    }
    if (turns) q = freeze_orientation(g, span, errors);
  }
  for (double& v : velocity) v /= unit;
  if (velocity == Vec3{0, 0, 0}) {
    store_still_shape(scene, i, q, g.sigma * unit);
  } else {
    store_shape(scene, i,
                shape_of_moving(quaternion_to_matrix(q), g.scale, velocity, g.sigma * unit));
  }
}

}  // namespace

void store_spacetime(const SpacetimeRows& rows, Scene& scene) {
  const double unit = duration(scene.timeline);  // seconds
  StgErrors errors;
  for (size_t i = 0; i < scene.count(); ++i) {
    const StgGaussian gaussian(rows, &scene.log_scale[4 * i], i);
    scene.mean_t[i] = static_cast<float>(gaussian.t * unit);
    if (gaussian.is_valid()) {
      store_gaussian(scene, i, gaussian, unit, &errors);
    } else {
      store_invalid_shape(scene, i);
    }
  }
  note_approximations(errors.motion, errors.turning, errors.largest_angle, scene);
}

}  // namespace l4d::io
