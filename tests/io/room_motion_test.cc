// SPDX-License-Identifier: Apache-2.0
// What moves in the room moves as the formulas of mechanics say, written down again here.
#include <algorithm>
#include <cmath>

#include "tests/io/place_support.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using test::Moving;

constexpr double kTau = 6.283185307179586;

std::vector<Moving> moving(const char* effect, uint64_t gaussians) {
  return test::moving("room", effect, gaussians);
}

double speed(const Moving& m) { return std::sqrt(dot(m.v, m.v)); }

TEST(RoomMotion, FanTurnsRigidly) {
  constexpr double kRate = 0.16 * kTau;  // radians a second
  size_t blades = 0;
  for (const char* effect : {"rigid", "frames"}) {
    for (const Moving& m : moving(effect, 30000)) {
      if (m.p[1] < 2.2) continue;
      const double x = m.p[0] + 0.15, z = m.p[2] - 0.25;
      ASSERT_LT(std::hypot(x, z), 0.80);
      ASSERT_NEAR(m.v[0], kRate * z, 2e-3);
      ASSERT_NEAR(m.v[2], -kRate * x, 2e-3);
      ASSERT_NEAR(m.v[1], 0, 1e-6);
      ++blades;
    }
  }
  EXPECT_GT(blades, 5000U);
}

TEST(RoomMotion, PendulumSwings) {
  size_t swinging = 0;
  for (const Moving& m : moving("rigid", 60000)) {
    const double x = m.p[0] - 1.86, down = 1.46 - m.p[1];
    if (std::abs(x) > 0.2 || m.p[2] > -2.5 || down < 0 || down > 0.8) continue;
    const double rate = 0.012 * kTau * 0.6 * kTau * std::cos(kTau * 0.6 * m.t);
    ASSERT_NEAR(m.v[0], down * rate, 2e-3) << m.t;
    ASSERT_NEAR(m.v[1], x * rate, 2e-3) << m.t;
    ASSERT_NEAR(m.v[2], 0, 1e-6);
    ++swinging;
  }
  EXPECT_GT(swinging, 1000U);
}

// The rocking chair rolls without sliding: it turns about where it stands, and what is there rests.
TEST(RoomMotion, ChairRocksOnTheFloor) {
  constexpr double kRadius = 1.2;
  const double c = std::cos(0.175 * kTau), s = std::sin(0.175 * kTau);
  size_t rocking = 0, low = 0;
  for (const Moving& m : moving("rigid", 60000)) {
    const double dx = m.p[0] + 1.42, dz = m.p[2] + 1.02;
    if (std::hypot(dx, dz) > 0.9 || m.p[1] > 1.5) continue;
    const double ahead = s * dx + c * dz;  // the way it looks
    const double angle = kTau * (-0.004 + 0.013 * std::sin(kTau * 0.25 * m.t));
    const double rate = 0.013 * kTau * 0.25 * kTau * std::cos(kTau * 0.25 * m.t);
    ASSERT_NEAR(s * m.v[0] + c * m.v[2], rate * m.p[1], 2e-3) << m.t;
    ASSERT_NEAR(m.v[1], -rate * (ahead - kRadius * angle), 2e-3) << m.t;
    ASSERT_NEAR(c * m.v[0] - s * m.v[2], 0, 1e-4);
    ASSERT_GT(m.p[1], -0.03);
    low += m.p[1] < 0.05;
    ++rocking;
  }
  EXPECT_GT(rocking, 20000U);
  EXPECT_GT(low, 100U);
}

TEST(RoomMotion, CurtainsHangAndTheCatBreathes) {
  double rod = 0, hem = 0, cat = 0, tail = 0;
  for (const Moving& m : moving("deform", 40000)) {
    if (m.p[0] < -3.0) {
      double& side = m.p[1] > 2.3 ? rod : hem;
      if (m.p[1] > 2.3 || m.p[1] < 0.5) side = std::max(side, speed(m));
      ASSERT_GT(m.p[0], -3.4);  // not through the wall
    } else if (std::abs(m.p[0] - 0.62) < 0.5 && std::abs(m.p[2] + 0.36) < 0.5 && m.p[1] < 0.4) {
      double& part = m.p[1] > 0.08 ? cat : tail;
      part = std::max(part, speed(m));
    }
  }
  EXPECT_GT(rod, 0.001);
  EXPECT_LT(rod, 0.06);
  EXPECT_GT(hem, 2 * rod);
  EXPECT_LT(hem, 0.4);
  EXPECT_GT(cat, 0.005);  // metres a second
  EXPECT_LT(cat, 0.04);
  EXPECT_GT(tail, 0.05);
  EXPECT_LT(tail, 0.4);
}

TEST(RoomMotion, RainFallsOutsideAndSparksSlowDown) {
  size_t rain = 0, panes = 0, sparks = 0;
  for (const Moving& m : moving("drops", 20000)) {
    if (m.p[0] < -3.55) {
      ++rain;
      ASSERT_LT(m.v[1], -5.1);
      ASSERT_GT(m.v[1], -6.1);
    } else if (m.p[0] < -3.4) {
      ++panes;
      ASSERT_LT(m.v[1], 0);
      ASSERT_GT(m.v[1], -1);
      ASSERT_GT(m.p[1], 1.06);  // within the window
      ASSERT_LT(m.p[1], 2.40);
    } else {
      ++sparks;
      // Thrown up by 0.9 to 1.6 m/s from the fire, braked by 1.8 m/s^2.
      const double top = m.p[1] + m.v[1] * m.v[1] / 3.6;
      ASSERT_GT(top, 0.18 + 0.81 / 3.6 - 1e-6);
      ASSERT_LT(top, 0.38 + 2.56 / 3.6 + 1e-6);
    }
  }
  EXPECT_GT(rain, 1000U);
  EXPECT_GT(panes, 1000U);
  EXPECT_GT(sparks, 1000U);
}

TEST(RoomMotion, FireBurnsFromTheBeginningToTheEnd) {
  size_t in[5] = {};
  for (const Moving& m : moving("flicker", 20000)) {
    if (m.p[2] > -1.9 || m.p[1] > 0.9 || m.p[1] < 0.06) continue;
    ASSERT_LT(std::abs(m.p[0] - 0.2), 0.55);  // within the hearth
    if (m.t >= 0 && m.t < 5) ++in[static_cast<int>(m.t)];
  }
  const auto [least, most] = std::minmax_element(std::begin(in), std::end(in));
  EXPECT_GT(*least, *most * 9 / 10);
  EXPECT_GT(*least, 2000U);
}

}  // namespace
}  // namespace l4d::io
