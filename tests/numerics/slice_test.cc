// SPDX-License-Identifier: Apache-2.0
// The three kinds of scenes that real ones are made of: how the textbook's slice fares in binary32,
// and ours.
#include "libl4dcodec/scene/slice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>

#include "tests/math/reference.h"
#include "tests/numerics/formula.h"

namespace l4d::numerics {
namespace {

using reference::Random;
using reference::Real;
using Json = nlohmann::ordered_json;

struct Kind {
  const char* name;
  double temporal;         // size of the rotor's temporal part
  double st_low, st_high;  // temporal scale, seconds
};
constexpr Kind kKinds[] = {{"short, moving", 0.05, 0.1, 2.0},
                           {"long, static", 1e-3, 10.0, 1000.0},
                           {"long, moving", 0.05, 10.0, 1000.0}};

struct Errors {
  std::vector<double> error;
  uint64_t indefinite = 0;

  void add(const float* covariance, const Real* expected) {
    const double e = reference::relative_error6(covariance, expected);
    error.push_back(std::isnan(e) ? HUGE_VAL : e);
    indefinite += !reference::positive_definite(covariance);
  }
  double quantile(double q) const { return reference::quantile(error, q); }
  double share() const {
    return static_cast<double>(indefinite) / static_cast<double>(error.size());
  }
  Json json() const {
    return {{"median", quantile(0.5)},
            {"p99", quantile(0.99)},
            {"max", quantile(1.0)},
            {"not_positive_definite", share()}};
  }
};

struct Both {
  Errors schur, ours;
};

// Spatial scales are 1e-3 to 1e-1. What differs is the slicing alone.
Both measure(const Kind& kind, int cases, uint64_t seed) {
  Random random(seed);
  Both out;
  for (int i = 0; i < cases; ++i) {
    float rotor[8], scale[4], rows[16];
    reference::random_rotor(random, kind.temporal, rotor);
    for (int k = 0; k < 3; ++k) scale[k] = static_cast<float>(random.log_uniform(1e-3, 1e-1));
    scale[3] = static_cast<float>(random.log_uniform(kind.st_low, kind.st_high));
    scaled_rows(normalized_halves(rotor), scale, rows);
    Real wide[16], expected[6];
    for (int k = 0; k < 16; ++k) wide[k] = Real(rows[k]);
    reference::minors(wide, expected);
    out.ours.add(slice_rows(rows).covariance, expected);
    float velocity[3], lambda, covariance[6];
    reference::schur(rows, velocity, &lambda, covariance);
    out.schur.add(covariance, expected);
  }
  return out;
}

TEST(SchurComplement, OfThreeKindsOfScenes) {
  Json table = Json::array();
  for (const Kind& kind : kKinds) {
    const Both both = measure(kind, 200000, 181);
    table.push_back(
        {{"kind", kind.name}, {"schur", both.schur.json()}, {"ours", both.ours.json()}});
    EXPECT_EQ(both.ours.indefinite, 0u) << kind.name;
    EXPECT_LT(both.ours.quantile(0.99), 2e-6) << kind.name;
    EXPECT_LT(both.ours.quantile(1.0), 1e-3) << kind.name;
    EXPECT_GT(both.schur.quantile(0.99), 50 * both.ours.quantile(0.99)) << kind.name;
  }
  EXPECT_GT(table[2]["schur"]["not_positive_definite"].get<double>(), 0.2);
  record("schur", table);
}

// Moving Gaussians of one temporal scale each: the error of the textbook grows with its square.
TEST(SchurComplement, AgainstTheTemporalScale) {
  Json series = Json::array();
  double last = 0;
  for (double st = 0.03; st < 4000; st *= std::sqrt(10.0)) {
    const Both both = measure({"", 0.05, st, st * 1.0001}, 8000, 182);
    series.push_back(
        {{"temporal_scale", st}, {"schur", both.schur.json()}, {"ours", both.ours.json()}});
    EXPECT_LT(both.ours.quantile(0.5), 3e-7) << st;
    if (st > 0.5 && st < 100) {
      EXPECT_GT(both.schur.quantile(0.5), 4 * last) << st;
    }
    last = both.schur.quantile(0.5);
  }
  EXPECT_GT(last, 1.0);
  record("schur_series", series);
}

// Ten powers of ten between the scales of one Gaussian, and no motion: the rows do not mix.
TEST(Slice, ScalesOfAStillGaussianStayApart) {
  Random random(183);
  for (int i = 0; i < 20000; ++i) {
    const int quarter = i % 4;
    // Turns by right angles about z keep the axes where they are.
    const float c = static_cast<float>(std::cos(quarter * M_PI / 4));
    const float s = static_cast<float>(std::sin(quarter * M_PI / 4));
    const float rotor[8] = {c, s, 0, 0, 0, 0, 0, 0};
    float scale[4];
    for (float& v : scale) v = static_cast<float>(std::exp(random.uniform(-16.0, 16.0)));
    const Slice4D<float> slice = slice_gaussian(normalized_halves(rotor), scale);
    const bool turned = quarter % 2 == 1;
    const float variance[3] = {turned ? scale[1] * scale[1] : scale[0] * scale[0],
                               turned ? scale[0] * scale[0] : scale[1] * scale[1],
                               scale[2] * scale[2]};
    ASSERT_NEAR(slice.covariance[5] / variance[2], 1, 1e-6);
    if (quarter != 0) continue;
    for (int k = 0; k < 3; ++k) {
      ASSERT_NEAR(slice.covariance[k == 0 ? 0 : k == 1 ? 3 : 5] / variance[k], 1, 1e-6);
    }
    for (const int k : {1, 2, 4}) ASSERT_EQ(slice.covariance[k], 0.0f);
    for (const float v : slice.velocity) ASSERT_EQ(v, 0.0f);
  }
}

// lambda from nearly nothing to its limit: never infinite, never zero, and falls off as it should.
TEST(Slice, LambdaOfAnyTemporalScale) {
  const float rotor[8] = {1, 0, 0, 0, 0, 0, 0, 0};
  float before = HUGE_VALF;
  for (double log_scale = -16; log_scale <= 16; log_scale += 0.01) {
    const float scale[4] = {1, 1, 1, static_cast<float>(std::exp(log_scale))};
    const float lambda = slice_gaussian(normalized_halves(rotor), scale).lambda;
    ASSERT_GT(lambda, 0.0f);
    ASSERT_LE(lambda, 1 / kMinTemporalVariance);
    ASSERT_LE(lambda, before);
    before = lambda;
  }
  // 24 hours fade a Gaussian of the largest scale by 5e-5.
  EXPECT_NEAR(std::exp(-0.5 * static_cast<double>(before) * 86400.0 * 86400.0), 1, 1e-4);
}

}  // namespace
}  // namespace l4d::numerics
