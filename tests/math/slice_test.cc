// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/scene/slice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <vector>

#include "tests/math/reference.h"

namespace l4d {
namespace {

using reference::Random;
using reference::Real;

constexpr int kCases = 50000;

struct Case {
  const char* name;
  double temporal;             // size of the rotor's temporal part
  double st_low, st_high;      // temporal scale, seconds
  double projected_p99_bound;  // relative error of the covariance in float
  double projected_max_bound;
};

// Spatial scales are 1e-3 .. 1e-1 scene units throughout.
constexpr Case kShortMoving = {"short moving", 0.05, 0.1, 2.0, 1e-6, 2e-6};
constexpr Case kLongStatic = {"long static", 1e-3, 10.0, 1000.0, 1e-6, 2e-6};
constexpr Case kLongMoving = {"long moving", 0.05, 10.0, 1000.0, 2e-6, 1e-3};

struct Outcome {
  double schur_p99, schur_max, schur_not_pd;  // the last as a share of all cases
  double projected_p99, projected_max;
  int projected_not_pd;
  double double_max;  // error of the double version
};

Outcome run(const Case& c) {
  Random random(11);
  std::vector<double> schur_error, projected_error;
  Outcome o{};
  int schur_not_pd = 0;
  for (int i = 0; i < kCases; ++i) {
    float rotor[8], scale[4];
    reference::random_rotor(random, c.temporal, rotor);
    for (int k = 0; k < 3; ++k) scale[k] = static_cast<float>(random.log_uniform(1e-3, 1e-1));
    scale[3] = static_cast<float>(random.log_uniform(c.st_low, c.st_high));

    // All methods start from the same float rows, so that what differs is the slicing alone.
    float rows[16];
    scaled_rows(normalized_halves(rotor), scale, rows);
    Real wide_rows[16], expected[6];
    double double_rows[16];
    for (int k = 0; k < 16; ++k) {
      wide_rows[k] = Real(rows[k]);
      double_rows[k] = static_cast<double>(rows[k]);
    }
    reference::minors(wide_rows, expected);

    const Slice4D<float> slice = slice_rows(rows);
    projected_error.push_back(reference::relative_error6(slice.covariance, expected));
    if (!reference::positive_definite(slice.covariance)) ++o.projected_not_pd;

    float velocity[3], lambda, covariance[6];
    reference::schur(rows, velocity, &lambda, covariance);
    schur_error.push_back(reference::relative_error6(covariance, expected));
    if (!reference::positive_definite(covariance)) ++schur_not_pd;

    const Slice4D<double> wide = slice_rows(double_rows);
    o.double_max = std::max(o.double_max, reference::relative_error6(wide.covariance, expected));
  }
  o.schur_p99 = reference::quantile(schur_error, 0.99);
  o.schur_max = reference::quantile(schur_error, 1.0);
  o.schur_not_pd = static_cast<double>(schur_not_pd) / kCases;
  o.projected_p99 = reference::quantile(projected_error, 0.99);
  o.projected_max = reference::quantile(projected_error, 1.0);
  std::cout << c.name << ": Schur p99 " << o.schur_p99 << ", max " << o.schur_max
            << ", not positive " << 100 * o.schur_not_pd << " %; projected p99 " << o.projected_p99
            << ", max " << o.projected_max << ", not positive " << o.projected_not_pd
            << "; double max " << o.double_max << "\n";
  EXPECT_LT(o.projected_p99, c.projected_p99_bound);
  EXPECT_LT(o.projected_max, c.projected_max_bound);
  EXPECT_EQ(o.projected_not_pd, 0);
  EXPECT_LT(o.double_max, 1e-11);
  EXPECT_GT(o.schur_p99, 10 * o.projected_p99);
  return o;
}

TEST(Slice, ShortMoving) { run(kShortMoving); }

TEST(Slice, LongStatic) { run(kLongStatic); }

TEST(Slice, LongMovingBreaksTheSchurComplementAndNotUs) {
  const Outcome o = run(kLongMoving);
  EXPECT_GT(o.schur_not_pd, 0.10);
  EXPECT_GT(o.schur_p99, 1.0);
}

TEST(Slice, AgreesWithTextbookInAllParts) {
  Random random(12);
  double worst_velocity = 0, worst_lambda = 0, worst_covariance = 0;
  for (int i = 0; i < kCases; ++i) {
    double rotor[8], scale[4], rows[16];
    reference::random_rotor(random, 0.3, rotor);
    for (double& s : scale) s = random.log_uniform(1e-2, 1.0);
    const RotorHalves<double> halves = normalized_halves(rotor);
    scaled_rows(halves, scale, rows);
    Real wide[16], velocity[3], lambda, covariance[6];
    for (int k = 0; k < 16; ++k) wide[k] = Real(rows[k]);
    reference::schur(wide, velocity, &lambda, covariance);

    const Slice4D<double> slice = slice_gaussian(halves, scale);
    Real speed = 0, error = 0;
    for (int k = 0; k < 3; ++k) {
      speed += velocity[k] * velocity[k];
      error += (Real(slice.velocity[k]) - velocity[k]) * (Real(slice.velocity[k]) - velocity[k]);
    }
    worst_velocity = std::max(worst_velocity, static_cast<double>(std::sqrt(error / speed)));
    worst_lambda = std::max(worst_lambda,
                            static_cast<double>(std::fabs(Real(slice.lambda) - lambda) / lambda));
    worst_covariance =
        std::max(worst_covariance, reference::relative_error6(slice.covariance, covariance));
  }
  std::cout << "against the textbook, double: velocity " << worst_velocity << ", lambda "
            << worst_lambda << ", covariance " << worst_covariance << "\n";
  EXPECT_LT(worst_velocity, 1e-12);
  EXPECT_LT(worst_lambda, 1e-14);
  EXPECT_LT(worst_covariance, 1e-12);
}

TEST(Slice, StaticGaussianDoesNotMove) {
  Random random(13);
  for (int i = 0; i < 1000; ++i) {
    float rotor[8], scale[4];
    reference::random_rotor(random, 0.0, rotor);
    for (float& s : scale) s = static_cast<float>(random.log_uniform(1e-4, 1e3));
    const Slice4D<float> slice = slice_gaussian(normalized_halves(rotor), scale);
    for (const float v : slice.velocity) EXPECT_EQ(v, 0.0f);
    const float variance = scale[3] * scale[3];
    EXPECT_NEAR(slice.lambda * variance, 1.0f, 1e-6f);
  }
}

// For a long-lived Gaussian the speed is twice the temporal part of its rotor.
TEST(Slice, SpeedOfSmallTemporalRotors) {
  Random random(14);
  for (int i = 0; i < 1000; ++i) {
    double rotor[8];
    const double scale[4] = {0.01, 0.02, 0.03, 100.0};
    reference::random_rotor(random, 1e-3, rotor);
    normalize_rotor(rotor, rotor);
    double part = 0, speed = 0;
    for (int k = 4; k < 8; ++k) part += rotor[k] * rotor[k];
    const Slice4D<double> slice = slice_gaussian(halves_of_rotor(rotor), scale);
    for (const double v : slice.velocity) speed += v * v;
    EXPECT_NEAR(std::sqrt(speed / part), 2.0, 1e-3);
  }
}

TEST(Slice, LambdaIsBounded) {
  const float rotor[8] = {1, 0, 0, 0, 0, 0, 0, 0};
  const float tiny[4] = {0.1f, 0.1f, 0.1f, 1e-9f};
  EXPECT_EQ(slice_gaussian(normalized_halves(rotor), tiny).lambda, 1.0f / 1e-12f);
  const float zero[4] = {0.1f, 0.2f, 0.3f, 0.0f};
  const Slice4D<float> slice = slice_gaussian(normalized_halves(rotor), zero);
  EXPECT_EQ(slice.lambda, 1.0f / 1e-12f);
  EXPECT_TRUE(reference::positive_definite(slice.covariance));
}

}  // namespace
}  // namespace l4d
