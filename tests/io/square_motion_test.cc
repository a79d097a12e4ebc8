// SPDX-License-Identifier: Apache-2.0
// What moves in the square moves as the formulas of mechanics say, written down again here.
#include <algorithm>
#include <cmath>

#include "tests/io/place_support.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

constexpr double kTau = 6.283185307179586, kGravity = 9.81;

using test::Moving;

std::vector<Moving> moving(const char* effect, uint64_t gaussians) {
  return test::moving("square", effect, gaussians);
}

// One of the carousel, from its axis, and where it was at second 0.
struct Rider {
  Vec3 rest;
  double t, rises;
};

TEST(SquareMotion, CarouselTurnsRigidly) {
  constexpr double kRate = 0.08 * kTau;  // radians a second
  std::vector<Rider> riders;
  for (const Moving& m : moving("rigid", 60000)) {
    const double x = m.p[0] - 3.6, z = m.p[2] + 2.6, r = std::hypot(x, z);
    if (r > 3.2) continue;
    ASSERT_NEAR(m.v[0], kRate * z, 2e-3) << r;
    ASSERT_NEAR(m.v[2], -kRate * x, 2e-3) << r;
    ASSERT_LE(std::abs(m.v[1]), 0.14 * 0.45 * kTau + 1e-3);  // horses rise and fall
    const double s = std::sin(kRate * m.t), c = std::cos(kRate * m.t);
    riders.push_back({{c * x - s * z, m.p[1], s * x + c * z}, m.t, m.v[1]});
  }
  ASSERT_GT(riders.size(), 20000U);
  std::sort(riders.begin(), riders.end(), [](const Rider& a, const Rider& b) { return a.t < b.t; });
  const auto earlier = [](const Rider& a, double t) { return a.t < t; };
  // What does not rise is at one place of the carousel, piece after piece, 0.28 s each.
  size_t followed = 0, all = 0;
  for (const Rider& a : riders) {
    if (a.t < 0.3 || a.t > 4.4 || std::abs(a.rises) > 1e-4) continue;
    ++all;
    const auto next = std::lower_bound(riders.begin(), riders.end(), a.t + 0.28 - 1e-4, earlier);
    for (auto b = next; b != riders.end() && b->t < a.t + 0.28 + 1e-4; ++b) {
      if (std::hypot(b->rest[0] - a.rest[0], b->rest[1] - a.rest[1], b->rest[2] - a.rest[2]) >
          1e-3) {
        continue;
      }
      ++followed;
      break;
    }
  }
  ASSERT_GT(all, 2000U);
  EXPECT_GT(followed, all * 98 / 100);  // up to 0.4 % are left out
}

TEST(SquareMotion, BallsFlyOnParabolas) {
  size_t flying = 0;
  for (const Moving& m : moving("rigid", 40000)) {
    if (std::abs(m.p[0] + 0.9) > 0.5 || std::abs(m.p[2] - 3.62) > 0.1 || m.p[1] < 1.5) continue;
    ++flying;
    // Half a second up from the hand at 1.24 m; the ball has a radius of 9.5 cm.
    const double top = m.p[1] + m.v[1] * m.v[1] / (2 * kGravity);
    ASSERT_NEAR(top, 1.24 + kGravity / 8, 0.1) << m.t;
    ASSERT_NEAR(std::abs(m.v[0]), 0.6, 2e-3);
  }
  EXPECT_GT(flying, 100U);
}

TEST(SquareMotion, DropsFallAsTheyWereThrown) {
  size_t jet = 0, spilt = 0;
  for (const Moving& m : moving("drops", 20000)) {
    if (m.v == Vec3{0, 0, 0}) continue;  // a ring on the water
    const double top = m.p[1] + m.v[1] * m.v[1] / (2 * kGravity);
    if (top > 2) {
      ++jet;
      ASSERT_NEAR(top, 1.85 + 3.3 * 3.3 / (2 * kGravity), 0.075);
    } else {
      ++spilt;
      ASSERT_NEAR(top, 1.5 + 0.9 * 0.9 / (2 * kGravity), 0.012);
    }
  }
  EXPECT_GT(jet, 1000U);
  EXPECT_GT(spilt, 1000U);
}

TEST(SquareMotion, FlagIsTheSumOfTwoWaves) {
  size_t cloth = 0;
  for (const Moving& m : moving("deform", 20000)) {
    const double a = (m.p[0] + 0.6) / 0.94;
    if (a < -0.05 || a > 2.35 || std::abs(m.p[2] + 5) > 0.7) continue;
    ++cloth;
    const double droop =
        0.05 * std::sin(kTau * (0.5 * a - 0.9 * m.t)) * a / 2.3 - 0.10 * a * a / 2.3;
    const double b = m.p[1] - 7.45 + 1.45 - droop, swing = 0.05 + 0.16 * a / 2.3;
    ASSERT_GT(b, -0.05);
    ASSERT_LT(b, 1.5);
    const double long_wave = kTau * (0.62 * a - 1.05 * m.t + 0.16 * b);
    const double short_wave = kTau * (1.15 * a + 0.3 * b - 1.7 * m.t);
    const double z = swing * std::sin(long_wave) + 0.35 * swing * std::sin(short_wave);
    ASSERT_NEAR(m.p[2], -5 + z + 0.12 * a, 1e-3) << m.t;
    const double speed =
        -kTau * swing * (1.05 * std::cos(long_wave) + 0.595 * std::cos(short_wave));
    ASSERT_NEAR(m.v[2], speed, 5e-3) << m.t;
  }
  EXPECT_GT(cloth, 1000U);
}

}  // namespace
}  // namespace l4d::io
