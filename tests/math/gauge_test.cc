// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/math/gauge.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <iostream>
#include <set>

#include "libl4dcodec/scene/slice.h"
#include "tests/common/random.h"
#include "tests/math/reference.h"

namespace l4d {
namespace {

using reference::Random;
using reference::Real;

constexpr GaugeMode kModes[] = {GaugeMode::kSign, GaugeMode::kNearestIdentity,
                                GaugeMode::kSortedScales};

template <typename T>
struct Gaussian {
  T rotor[8];
  T log_scale[4];
};

// Ordinary Gaussians, and those that trained scenes also have: temporal scales of hundreds of
// seconds on millimetre Gaussians, ratios of scales of 10^6, equal scales, static rotors, rotors
// far from valid and at the borders between frames.
template <typename T>
Gaussian<T> random_gaussian(Random& random, int i) {
  static constexpr double kTemporal[4] = {0.0, 1e-4, 0.05, 1.0};
  Gaussian<T> g;
  reference::random_rotor(random, kTemporal[i & 3], g.rotor);
  for (T& s : g.log_scale) s = static_cast<T>(random.uniform(-11.0, 3.0));
  g.log_scale[3] = static_cast<T>(random.uniform(-3.0, 6.0));
  switch ((i >> 2) & 7) {
    case 1:
      g.log_scale[1] = g.log_scale[0];
      break;
    case 2:
      g.log_scale[2] = g.log_scale[1] = g.log_scale[0];
      break;
    case 3:  // exactly between two frames
      for (T& c : g.rotor) c = static_cast<T>(0);
      g.rotor[kRotorS] = static_cast<T>(std::cos(0.39269908169872414));
      g.rotor[kRotorB12] = static_cast<T>(std::sin(0.39269908169872414));
      break;
    case 4:  // no s
      for (T& c : g.rotor) c = static_cast<T>(0);
      g.rotor[1 + random.below(7)] = static_cast<T>(-1);
      break;
    case 5:  // a common factor is free
      for (T& c : g.rotor) c = c * static_cast<T>(37);
      break;
    default:
      break;
  }
  return g;
}

template <typename T>
double covariance_change(const Gaussian<T>& a, const Gaussian<T>& b) {
  // The textbook normalisation has no answer for a rotor with a vanishing half: take ours.
  Real sigma[2][4][4];
  const Gaussian<T>* both[2] = {&a, &b};
  for (int i = 0; i < 2; ++i) {
    double rotor[8], log_scale[4];
    for (int k = 0; k < 8; ++k) rotor[k] = static_cast<double>(both[i]->rotor[k]);
    for (int k = 0; k < 4; ++k) log_scale[k] = static_cast<double>(both[i]->log_scale[k]);
    normalize_rotor(rotor, rotor);
    reference::covariance4(rotor, log_scale, sigma[i]);
  }
  return reference::relative_error4(sigma[1], sigma[0]);
}

template <typename T>
void covariance_is_kept(double bound) {
  double worst = 0;
  for (const GaugeMode mode : kModes) {
    Random random(21);
    for (int i = 0; i < 50000; ++i) {
      const Gaussian<T> before = random_gaussian<T>(random, i);
      Gaussian<T> after = before;
      canonicalize(after.rotor, after.log_scale, mode);
      ASSERT_GE(after.rotor[kRotorS], static_cast<T>(0));
      ASSERT_EQ(after.log_scale[3], before.log_scale[3]);
      worst = std::max(worst, covariance_change(before, after));
    }
  }
  std::cout << "canonicalize, " << sizeof(T) * 8 << " bit: max relative change of the covariance "
            << worst << "\n";
  EXPECT_LT(worst, bound);
}

TEST(Gauge, CovarianceIsKeptInDouble) { covariance_is_kept<double>(1e-13); }
TEST(Gauge, CovarianceIsKeptInFloat) { covariance_is_kept<float>(1e-6); }

// The halves of a rotor to be at most a right angle apart, by turning one round where it has to be.
TEST(Gauge, HalvesAreAligned) {
  test::Random random(7);
  size_t turned = 0;
  for (int n = 0; n < 1000; ++n) {
    RotorHalves<double> h;
    for (double& v : h.a) v = random.normal();
    for (double& v : h.b) v = random.normal();
    normalize_half(h.a);
    normalize_half(h.b);
    double rotor[8], aligned[8];
    rotor_of_halves(h, rotor);
    std::copy_n(rotor, 8, aligned);
    align_halves(aligned);
    const RotorHalves<double> out = halves_of_rotor(aligned);
    const double dot = dot4(out.a, out.b);
    EXPECT_GE(dot, -1e-12);
    turned += dot4(h.a, h.b) < 0;
    const double scale[4] = {0.5, 2, 1, 3};
    const Slice4D<double> was = slice_gaussian(normalized_halves(rotor), scale);
    const Slice4D<double> is = slice_gaussian(normalized_halves(aligned), scale);
    EXPECT_NEAR(is.lambda, was.lambda, 1e-12 * was.lambda);
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(is.velocity[k], was.velocity[k], 1e-9);
    for (int k = 0; k < 6; ++k) EXPECT_NEAR(is.covariance[k], was.covariance[k], 1e-9);
  }
  EXPECT_GT(turned, 400u);
}

TEST(Gauge, DegenerateHalfKeepsItsMeaning) {
  Gaussian<double> before{{0.5, 0.25, -0.75, 0.125, 0.125, 0.75, 0.25, -0.5}, {-1, -2, -3, 1}};
  for (const GaugeMode mode : kModes) {
    Gaussian<double> after = before;
    canonicalize(after.rotor, after.log_scale, mode);
    EXPECT_LT(covariance_change(before, after), 1e-13);
  }
}

TEST(Gauge, CubeRotationsAreAGroupOfFramesWithTheirAxes) {
  std::set<std::array<int, 9>> distinct;
  for (const CubeRotation& turn : kCubeRotations) {
    int norm2 = 0;
    for (const int c : turn.q) norm2 += c * c;
    EXPECT_EQ(norm2, turn.norm2);
    RotorHalves<double> identity{{1, 0, 0, 0}, {1, 0, 0, 0}};
    turn_half(turn, identity.a);
    turn_half(turn, identity.b);
    double m[16];
    rotor_to_matrix(identity, m);
    EXPECT_NEAR(m[15], 1.0, 1e-15);
    std::array<int, 9> rounded{};
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        const double value = m[4 * i + j];
        EXPECT_NEAR(std::fabs(value), turn.axis[j] == i ? 1.0 : 0.0, 1e-15);
        rounded[static_cast<size_t>(3 * i + j)] = static_cast<int>(std::lround(value));
      }
    }
    distinct.insert(rounded);
  }
  EXPECT_EQ(distinct.size(), 24u);
}

// Turning both halves is multiplying the matrix from the right.
TEST(Gauge, TurnActsOnTheLocalFrame) {
  Random random(22);
  for (int i = 0; i < 200; ++i) {
    double rotor[8], before[16], turned[16], frame[16];
    reference::random_rotor(random, 0.5, rotor);
    const RotorHalves<double> halves = normalized_halves(rotor);
    rotor_to_matrix(halves, before);
    for (const CubeRotation& turn : kCubeRotations) {
      RotorHalves<double> h = halves, identity{{1, 0, 0, 0}, {1, 0, 0, 0}};
      turn_half(turn, h.a);
      turn_half(turn, h.b);
      turn_half(turn, identity.a);
      turn_half(turn, identity.b);
      rotor_to_matrix(h, turned);
      rotor_to_matrix(identity, frame);
      for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) {
          double product = 0;
          for (int k = 0; k < 4; ++k) product += before[4 * r + k] * frame[4 * k + c];
          ASSERT_NEAR(turned[4 * r + c], product, 2e-15);
        }
      }
    }
  }
}

// Every one of the 48 descriptions of a Gaussian leads to the same representative.
TEST(Gauge, RepresentativeDoesNotDependOnTheDescription) {
  Random random(23);
  double worst = 0;
  for (const GaugeMode mode : {GaugeMode::kNearestIdentity, GaugeMode::kSortedScales}) {
    for (int i = 0; i < 500; ++i) {
      Gaussian<double> g;
      reference::random_rotor(random, i % 2 == 0 ? 0.0 : 0.1, g.rotor);
      for (double& s : g.log_scale) s = random.uniform(-6.0, 1.0);
      const RotorHalves<double> halves = normalized_halves(g.rotor);
      Gaussian<double> representative = g;
      canonicalize(representative.rotor, representative.log_scale, mode);
      for (const CubeRotation& turn : kCubeRotations) {
        RotorHalves<double> h = halves;
        turn_half(turn, h.a);
        turn_half(turn, h.b);
        Gaussian<double> other;
        rotor_of_halves(h, other.rotor);
        const double sign = random.uniform() < 0.5 ? -3.0 : 3.0;
        for (double& c : other.rotor) c *= sign;
        for (int j = 0; j < 3; ++j) other.log_scale[j] = g.log_scale[turn.axis[j]];
        other.log_scale[3] = g.log_scale[3];
        canonicalize(other.rotor, other.log_scale, mode);
        for (int k = 0; k < 8; ++k) {
          worst = std::max(worst, std::fabs(other.rotor[k] - representative.rotor[k]));
        }
        for (int k = 0; k < 4; ++k) ASSERT_EQ(other.log_scale[k], representative.log_scale[k]);
      }
    }
  }
  std::cout << "48 descriptions, one representative: max difference " << worst << "\n";
  EXPECT_LT(worst, 1e-14);
}

template <typename T>
void representative_is_its_own(T bound) {
  for (const GaugeMode mode : kModes) {
    Random random(24);
    for (int i = 0; i < 20000; ++i) {
      Gaussian<T> once = random_gaussian<T>(random, i);
      canonicalize(once.rotor, once.log_scale, mode);
      Gaussian<T> twice = once;
      canonicalize(twice.rotor, twice.log_scale, mode);
      for (int k = 0; k < 8; ++k) ASSERT_NEAR(twice.rotor[k], once.rotor[k], bound);
      ASSERT_EQ(std::memcmp(twice.log_scale, once.log_scale, sizeof(once.log_scale)), 0);
    }
  }
}

TEST(Gauge, RepresentativeIsItsOwnInDouble) { representative_is_its_own<double>(1e-15); }
TEST(Gauge, RepresentativeIsItsOwnInFloat) { representative_is_its_own<float>(2e-7f); }

TEST(Gauge, StaticStaysStatic) {
  Random random(25);
  for (int i = 0; i < 20000; ++i) {
    Gaussian<float> g;
    reference::random_rotor(random, 0.0, g.rotor);
    for (float& s : g.log_scale) s = static_cast<float>(random.uniform(-9.0, 0.0));
    canonicalize(g.rotor, g.log_scale, kModes[i % 3]);
    for (int k = 4; k < 8; ++k) ASSERT_EQ(g.rotor[k], 0.0f);
  }
}

// No rotation is further than 62.8 degrees from the nearest of the 24, so s >= cos(31.4 degrees).
TEST(Gauge, NearestIdentityIsNear) {
  Random random(26);
  double smallest = 1.0;
  for (int i = 0; i < 50000; ++i) {
    Gaussian<double> g;
    reference::random_rotor(random, 0.0, g.rotor);
    for (double& s : g.log_scale) s = random.uniform(-9.0, 0.0);
    canonicalize(g.rotor, g.log_scale, GaugeMode::kNearestIdentity);
    smallest = std::min(smallest, g.rotor[kRotorS]);
  }
  std::cout << "nearest identity: smallest s " << smallest << "\n";
  EXPECT_GE(smallest, 0.8535);
}

TEST(Gauge, ScalesAreSorted) {
  Random random(27);
  for (int i = 0; i < 20000; ++i) {
    Gaussian<float> g = random_gaussian<float>(random, i);
    const Gaussian<float> before = g;
    canonicalize(g.rotor, g.log_scale, GaugeMode::kSortedScales);
    float sorted[3] = {before.log_scale[0], before.log_scale[1], before.log_scale[2]};
    std::sort(sorted, sorted + 3, [](float a, float b) { return a > b; });
    ASSERT_EQ(std::memcmp(sorted, g.log_scale, sizeof(sorted)), 0);
  }
}

TEST(Gauge, SignChangesNothingElse) {
  float rotor[8] = {-0.0f, 0.0f, -0.5f, 0.25f, -0.125f, 0.0f, 1.0f, 2.0f};
  float log_scale[4] = {1, 2, 3, 4};
  canonicalize(rotor, log_scale, GaugeMode::kSign);
  const float expected[8] = {0.0f, 0.0f, 0.5f, -0.25f, 0.125f, 0.0f, -1.0f, -2.0f};
  EXPECT_EQ(std::memcmp(rotor, expected, sizeof(rotor)), 0);
}

}  // namespace
}  // namespace l4d
