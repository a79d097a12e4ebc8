// SPDX-License-Identifier: Apache-2.0
// What a viewer sees of a decoded stream against the scene that was encoded, in double precision
// and without the formulas of the library.
#pragma once

#include <Eigen/Dense>

#include "l4d/experimental/inspect.h"
#include "tests/common/codec.h"

namespace l4d::numerics {

// Largest errors of single Gaussians, as section 8.5 of the specification defines them.
struct Worst {
  double position = 0, covariance = 1, opacity = 0, mean_time = 0;
  double base_color = 0, directional_color = 0;
};

// A Gaussian over time; lengths in scene units, times in seconds.
struct Seen {
  Eigen::Vector3d position, velocity;
  Eigen::Matrix3d covariance;
  double mean, sigma, reference, opacity;

  Eigen::Vector3d at(double t) const { return position + velocity * (t - reference); }
  double opacity_at(double t) const {
    const double z = (t - mean) / sigma;
    return std::fabs(z) <= 4 ? opacity * std::exp(-0.5 * z * z) : 0;
  }
};

Seen seen_of(const float* position, double mean, const float* log_scale, const float* rotor,
             float opacity, double begin, double end);

// The size below which errors do not count: 1/4000 of the largest side of the box of nine tenths of
// the scene, and a quarter.
double min_size(const test::TestScene& scene);

// Adds the errors of the colours of Gaussian i of the scene, decoded as Gaussian j: of the mean
// over directions, and the most that the rest can add in any direction. In colour units, or in
// parts of the largest colour if that is above 1.
void add_colors(const test::TestScene& scene, size_t i, const GaussianArrays& decoded, size_t j,
                Worst* worst);

// own_min_size: of all Gaussians, scene units.
Worst worst_errors(const test::TestScene& scene, const test::Encoded& encoded,
                   double own_min_size = 0);

// The statement of a stream.
l4d_coding_errors stated_errors(const Bytes& bytes);

// The same scene in units that are 1/scale as long, and `later` seconds later: positions, sizes and
// velocities are multiplied by `scale`.
test::TestScene in_other_units(const test::TestScene& scene, double scale, double later);

}  // namespace l4d::numerics
