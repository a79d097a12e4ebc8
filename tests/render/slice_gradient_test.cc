// SPDX-License-Identifier: Apache-2.0
// Derivatives of slicing against differences of the textbook's formulas in long double.
#include "render/frame/slice_gradient.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "tests/math/reference.h"
#include "tests/render/differences.h"

namespace l4d::render {
namespace {

using differences::Errors;
using reference::Random;
using reference::Real;

constexpr int kCases = 600;
constexpr int kOutputs = 10;  // position, covariance, opacity

// One of the 17 numbers of a Gaussian.
struct Input {
  const char* attribute;
  int index;
};

constexpr Input kInputs[] = {{"position", 0},  {"position", 1},  {"position", 2},  {"mean_t", 0},
                             {"log_scale", 0}, {"log_scale", 1}, {"log_scale", 2}, {"log_scale", 3},
                             {"rotor", 0},     {"rotor", 1},     {"rotor", 2},     {"rotor", 3},
                             {"rotor", 4},     {"rotor", 5},     {"rotor", 6},     {"rotor", 7},
                             {"opacity", 0}};

template <typename G>
auto& number(G& g, const Input& input) {
  const std::string name = input.attribute;
  if (name == "position") return g.position[input.index];
  if (name == "mean_t") return g.mean_t;
  if (name == "log_scale") return g.log_scale[input.index];
  if (name == "rotor") return g.rotor[input.index];
  return g.opacity;
}

Gaussian4D<Real> widen(const Gaussian4D<double>& g) {
  Gaussian4D<Real> wide;
  for (const Input& input : kInputs) number(wide, input) = Real(number(g, input));
  return wide;
}

void rows_of(const Gaussian4D<Real>& g, Real* rows /* [4, 4] */) {
  Real matrix[4][4];
  reference::matrix(reference::normalize(reference::load(g.rotor)), matrix);
  for (int i = 0; i < 16; ++i) rows[i] = matrix[i / 4][i % 4] * std::exp(g.log_scale[i % 4]);
}

Real variance_of(const Real* rows) {
  Real sum = 0;
  for (int k = 12; k < 16; ++k) sum += rows[k] * rows[k];
  return sum;
}

// The slice from the definitions: position, covariance, opacity.
std::vector<Real> textbook(const Gaussian4D<Real>& g, const Instant<double>& instant) {
  Real rows[16];
  rows_of(g, rows);
  const Real* mt = rows + 12;
  const Real variance = std::max(variance_of(rows), Real(kMinTemporalVariance));
  const Real begin = Real(instant.begin), end = Real(instant.end), time = Real(instant.time);
  const Real reference = instant.at_mean_time ? g.mean_t : std::clamp(g.mean_t, begin, end);
  std::vector<Real> out;
  Real sigma[3][3], velocity[3];
  for (int i = 0; i < 3; ++i) {
    Real mixed = 0;
    for (int k = 0; k < 4; ++k) mixed += rows[4 * i + k] * mt[k];
    velocity[i] = mixed / variance;
    out.push_back(g.position[i] + velocity[i] * (time - reference));
  }
  Real covariance[6];
  if (variance > variance_of(rows)) {
    int entry = 0;
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) {
        sigma[i][j] = 0;
        for (int k = 0; k < 4; ++k) {
          sigma[i][j] +=
              (rows[4 * i + k] - velocity[i] * mt[k]) * (rows[4 * j + k] - velocity[j] * mt[k]);
        }
        covariance[entry++] = sigma[i][j];
      }
    }
  } else {
    reference::minors(rows, covariance);
  }
  out.insert(out.end(), covariance, covariance + 6);
  const Real opacity = instant.logit ? 1 / (1 + std::exp(-g.opacity)) : g.opacity;
  const Real dt = time - g.mean_t;
  out.push_back(opacity * std::exp(-dt * dt / (2 * variance)));
  return out;
}

struct Case {
  Gaussian4D<double> gaussian;
  Instant<double> instant;
};

struct Kind {
  const char* name;
  double log_scale[2], log_scale_t[2];
  double temporal;       // size of the rotor's temporal part
  double log_length[2];  // of the rotor
  double outside;  // the mean lies up to this far after the end, seconds; 0 = near the instant
  bool logit;
};

double round_to_float(double x) { return static_cast<double>(static_cast<float>(x)); }

// All numbers are floats, so that both types of arithmetic start from the same.
Case random_case(Random& random, const Kind& kind) {
  Case c;
  Gaussian4D<double>& g = c.gaussian;
  c.instant.begin = 3;
  c.instant.end = 13;
  c.instant.time = round_to_float(random.uniform(3.5, 12.5));
  c.instant.at_mean_time = random.below(2) == 1;
  c.instant.logit = kind.logit;
  for (double& p : g.position) p = random.uniform(-5, 5);
  for (double& s : g.log_scale) s = random.uniform(kind.log_scale[0], kind.log_scale[1]);
  g.log_scale[3] = random.uniform(kind.log_scale_t[0], kind.log_scale_t[1]);
  reference::random_rotor(random, kind.temporal, g.rotor);
  const double length = std::exp(random.uniform(kind.log_length[0], kind.log_length[1]));
  for (double& r : g.rotor) r *= length;
  g.opacity = kind.logit ? random.uniform(-8, 8) : random.uniform(0.01, 1);
  for (const Input& input : kInputs) {
    if (&number(g, input) != &g.mean_t) number(g, input) = round_to_float(number(g, input));
  }
  Real rows[16];
  rows_of(widen(g), rows);
  const double sigma = std::sqrt(
      std::max(static_cast<double>(variance_of(rows)), static_cast<double>(kMinTemporalVariance)));
  do {
    g.mean_t = round_to_float(kind.outside > 0 ? c.instant.end + random.uniform(0.1, kind.outside)
                                               : c.instant.time + sigma * random.uniform(-4, 4));
    // The reference time has no derivative where the clamp sets in.
  } while (std::fabs(g.mean_t - 3) < 0.01 * sigma || std::fabs(g.mean_t - 13) < 0.01 * sigma);
  return c;
}

// A step in which the slice hardly bends.
Real step_of(const Case& c, const Input& input) {
  const std::string name = input.attribute;
  Real rows[16];
  rows_of(widen(c.gaussian), rows);
  const Real floor = Real(kMinTemporalVariance);
  if (name == "mean_t") return std::sqrt(std::max(variance_of(rows), floor)) * 1e-3L;
  if (name != "rotor") return 4e-3L;
  // A rotor turns by its step over the length of its shorter half. Nearly sideways in time it is
  // the temporal variance that sets the scale.
  const RotorHalves<double> h = halves_of_rotor(c.gaussian.rotor);
  const Real length = std::sqrt(Real(std::min(dot4(h.a, h.a), dot4(h.b, h.b))));
  const Real longest =
      std::exp(Real(*std::max_element(c.gaussian.log_scale, c.gaussian.log_scale + 4)));
  const Real turn = std::sqrt(std::max(variance_of(rows), floor)) / longest;
  return length * std::min(turn, Real(1)) * 1e-3L;
}

using Jacobian = std::array<std::vector<Real>, std::size(kInputs)>;

Jacobian numeric_jacobian(const Case& c) {
  Jacobian out;
  const Gaussian4D<Real> wide = widen(c.gaussian);
  for (size_t k = 0; k < std::size(kInputs); ++k) {
    const auto slice = [&](Real value) {
      Gaussian4D<Real> g = wide;
      number(g, kInputs[k]) = value;
      return textbook(g, c.instant);
    };
    out[k] = differences::derivative(slice, Real(number(wide, kInputs[k])), step_of(c, kInputs[k]));
  }
  return out;
}

template <typename T>
Gradient4D<T> analytic(const Case& c, const double* weight /* [kOutputs] */) {
  Gaussian4D<T> g;
  for (const Input& input : kInputs) number(g, input) = static_cast<T>(number(c.gaussian, input));
  const Instant<T> instant{static_cast<T>(c.instant.time), static_cast<T>(c.instant.begin),
                           static_cast<T>(c.instant.end), c.instant.at_mean_time, c.instant.logit};
  SplatGradient3D<T> upstream;
  for (int k = 0; k < 3; ++k) upstream.position[k] = static_cast<T>(weight[k]);
  for (int k = 0; k < 6; ++k) upstream.covariance[k] = static_cast<T>(weight[3 + k]);
  upstream.opacity = static_cast<T>(weight[9]);
  return slice_gradient(g, instant, upstream);
}

template <typename T>
void compare(const Jacobian& jacobian, const Case& c, const double* weight, Errors* errors) {
  Gradient4D<T> gradient = analytic<T>(c, weight);
  const std::vector<Real> slice = textbook(widen(c.gaussian), c.instant);
  Real size = 0;
  for (size_t j = 0; j < kOutputs; ++j) size += std::fabs(Real(weight[j]) * slice[j]);
  const RotorHalves<double> h = halves_of_rotor(c.gaussian.rotor);
  const Real length = std::sqrt(Real(std::min(dot4(h.a, h.a), dot4(h.b, h.b))));
  Real by_scale = 0;
  for (size_t k = 0; k < std::size(kInputs);) {
    std::vector<double> ours, numeric;
    const std::string name = kInputs[k].attribute;
    Real noise = 4 * std::numeric_limits<Real>::epsilon() * size / step_of(c, kInputs[k]);
    for (; k < std::size(kInputs) && name == kInputs[k].attribute; ++k) {
      Real sum = 0;
      for (size_t j = 0; j < kOutputs; ++j) sum += Real(weight[j]) * jacobian[k][j];
      if (name == "log_scale") by_scale = std::max(by_scale, std::fabs(sum));
      ours.push_back(static_cast<double>(number(gradient, kInputs[k])));
      numeric.push_back(static_cast<double>(sum));
    }
    // That by the rotor is what is left of that by the rows when its part along them, which is that
    // by the scales, is taken off.
    if (name == "rotor") noise += 16 * Real(std::numeric_limits<T>::epsilon()) * by_scale / length;
    errors->add(name, ours, numeric, static_cast<double>(noise));
  }
}

// The sum of all outputs, and position, covariance and opacity by themselves: a small part must not
// hide behind a large one. Covariances count in units of their trace.
template <typename T>
void check(const Kind& kind, double bound) {
  Random random(31);
  Errors errors;
  for (int i = 0; i < kCases; ++i) {
    const Case c = random_case(random, kind);
    const Jacobian jacobian = numeric_jacobian(c);
    const Slice3D<double> slice = slice_at(c.gaussian, c.instant);
    const double trace = slice.covariance[0] + slice.covariance[3] + slice.covariance[5];
    double weight[kOutputs];
    for (double& w : weight) w = random.normal();
    for (int k = 3; k < 9; ++k) weight[k] /= trace;
    for (const auto& [first, last] : {std::pair(0, 10), {0, 3}, {3, 9}, {9, 10}}) {
      double part[kOutputs] = {};
      std::copy(weight + first, weight + last, part + first);
      compare<T>(jacobian, c, part, &errors);
    }
  }
  const bool is_float = std::is_same_v<T, float>;
  errors.report(std::string(kind.name) + (is_float ? ", float" : ""), bound);
}

constexpr Kind kModerate = {"moderate", {-4, 0}, {-2, 1}, 0.3, {0, 0}, 0, false};
constexpr Kind kLongMoving = {"long-lived moving", {-10, -2}, {2.3, 5.01}, 0.05, {0, 0}, 0, false};
constexpr Kind kExtreme = {"scales e^-10 to e^3", {-10, 3}, {-10, 3}, 1, {0, 0}, 0, false};
constexpr Kind kFarFromUnit = {"rotors far from unit", {-4, 0}, {-2, 3}, 0.5, {-5, 14}, 0, false};
constexpr Kind kOutside = {"mean to 200 s outside", {-8, 0}, {4, 5.01}, 0.05, {0, 0}, 200, false};
constexpr Kind kStill = {"no temporal part", {-8, 0}, {-2, 5.01}, 0, {-1, 1}, 0, false};
constexpr Kind kLogit = {"logits", {-4, 0}, {-2, 1}, 0.3, {0, 0}, 0, true};
constexpr Kind kClamped = {"clamped variance", {-10, -8}, {-16, -15}, 1e-4, {0, 0}, 0, false};

TEST(SliceGradient, Moderate) { check<double>(kModerate, 1e-9); }
TEST(SliceGradient, LongLivedMoving) { check<double>(kLongMoving, 1e-6); }
TEST(SliceGradient, LargeScaleRatios) { check<double>(kExtreme, 1e-6); }
TEST(SliceGradient, RotorsFarFromUnit) { check<double>(kFarFromUnit, 1e-9); }
TEST(SliceGradient, MeanOutsideTheSequence) { check<double>(kOutside, 1e-6); }
TEST(SliceGradient, NoTemporalPart) { check<double>(kStill, 1e-9); }
TEST(SliceGradient, Logits) { check<double>(kLogit, 1e-9); }
TEST(SliceGradient, ClampedVariance) { check<double>(kClamped, 1e-6); }

TEST(SliceGradient, SliceIsTheTextbooks) {
  Random random(32);
  double worst = 0;
  for (const Kind& kind :
       {kModerate, kLongMoving, kExtreme, kFarFromUnit, kOutside, kStill, kLogit, kClamped}) {
    for (int i = 0; i < kCases; ++i) {
      const Case c = random_case(random, kind);
      const std::vector<Real> expected = textbook(widen(c.gaussian), c.instant);
      const Slice3D<double> s = slice_at(c.gaussian, c.instant);
      for (size_t k = 0; k < 3; ++k) {
        const double size = 1 + std::fabs(static_cast<double>(expected[k]));
        EXPECT_NEAR(s.position[k], static_cast<double>(expected[k]), 1e-9 * size) << kind.name;
      }
      worst = std::max(worst, reference::relative_error6(s.covariance, &expected[3]));
      EXPECT_NEAR(s.opacity, static_cast<double>(expected[9]), 1e-11) << kind.name;
      Real rows[16];
      rows_of(widen(c.gaussian), rows);
      const Real dt = Real(c.instant.time) - Real(c.gaussian.mean_t);
      const Real q = dt * dt / std::max(variance_of(rows), Real(kMinTemporalVariance));
      if (std::fabs(q - 16) > 1e-6L) {
        EXPECT_EQ(s.visible, q < 16) << kind.name;
      }
    }
  }
  std::cout << "covariance of slice_at: largest relative error " << worst << "\n";
  EXPECT_LT(worst, 1e-7);
}

// A half without direction counts as (1, 0, 0, 0) whatever it is.
TEST(SliceGradient, ShortHalfIsConstant) {
  Random random(33);
  for (int i = 0; i < 100; ++i) {
    Case c = random_case(random, kModerate);
    RotorHalves<double> h = normalized_halves(c.gaussian.rotor);
    double* vanishing = i % 2 == 0 ? h.a : h.b;
    for (int k = 0; k < 4; ++k) vanishing[k] *= 1e-9;
    rotor_of_halves(h, c.gaussian.rotor);
    double weight[kOutputs];
    for (double& w : weight) w = random.normal();
    const Gradient4D<double> gradient = analytic<double>(c, weight);
    const RotorHalves<double> by_half = halves_of_rotor(gradient.rotor);
    // Halves and rotors are related by an orthogonal map times sqrt(2), which derivatives share.
    double largest = 0;
    for (int k = 0; k < 4; ++k) {
      EXPECT_NEAR((i % 2 == 0 ? by_half.a : by_half.b)[k], 0, 1e-12);
      largest = std::max(largest, std::fabs((i % 2 == 0 ? by_half.b : by_half.a)[k]));
    }
    EXPECT_GT(largest, 1e-6);
    // Against differences, which see the fallback of slice_at itself.
    for (int k = 0; k < 8; ++k) {
      const auto scalar = [&](double value) {
        Gaussian4D<double> g = c.gaussian;
        g.rotor[k] = value;
        const Slice3D<double> s = slice_at(g, c.instant);
        double sum = weight[9] * s.opacity;
        for (int j = 0; j < 3; ++j) sum += weight[j] * s.position[j];
        for (int j = 0; j < 6; ++j) sum += weight[3 + j] * s.covariance[j];
        return std::vector<double>{sum};
      };
      // Half the rotor's step reaches the short half: it must stay short.
      const double numeric = differences::derivative(scalar, c.gaussian.rotor[k], 1e-7)[0];
      EXPECT_NEAR(gradient.rotor[k], numeric, 1e-6 * (1 + largest));
    }
  }
}

// Turning up the length of a rotor, or of either half, changes nothing.
TEST(SliceGradient, LengthOfTheRotorIsFree) {
  Random random(34);
  for (int i = 0; i < 1000; ++i) {
    const Case c = random_case(random, i % 2 == 0 ? kFarFromUnit : kExtreme);
    const double weight[kOutputs] = {1, -2, 3, 1, 2, 3, -1, -2, -3, 1};
    const Gradient4D<double> gradient = analytic<double>(c, weight);
    const RotorHalves<double> h = halves_of_rotor(c.gaussian.rotor);
    const RotorHalves<double> by = halves_of_rotor(gradient.rotor);
    const double size = std::sqrt(dot4(by.a, by.a) + dot4(by.b, by.b));
    EXPECT_LT(std::fabs(dot4(h.a, by.a)), 1e-12 * size * std::sqrt(dot4(h.a, h.a)));
    EXPECT_LT(std::fabs(dot4(h.b, by.b)), 1e-12 * size * std::sqrt(dot4(h.b, h.b)));
  }
}

TEST(SliceGradient, ReferenceTime) {
  Gaussian4D<double> g{};
  Instant<double> instant{5, 3, 13, false, false};
  g.rotor[kRotorS] = 1;
  g.rotor[kRotorB03] = 0.1;  // motion along x
  for (double& s : g.log_scale) s = -2;
  g.log_scale[3] = 4;
  g.opacity = 0.5;
  SplatGradient3D<double> upstream;
  upstream.position[0] = 1;
  g.mean_t = 6;
  const double inside = slice_gradient(g, instant, upstream).mean_t;
  EXPECT_NE(inside, 0);
  for (const double outside : {-50.0, 60.0}) {
    g.mean_t = outside;
    instant.at_mean_time = false;
    EXPECT_EQ(slice_gradient(g, instant, upstream).mean_t, 0);
    instant.at_mean_time = true;
    EXPECT_EQ(slice_gradient(g, instant, upstream).mean_t, inside);
  }
}

// What scales differ by must not cost digits: a long-lived moving Gaussian is as exact as any
// other.
TEST(SliceGradient, Float) {
  check<float>(kModerate, 1e-3);
  check<float>(kLongMoving, 1e-3);
  check<float>(kOutside, 1e-3);
  check<float>(kStill, 1e-3);
}

}  // namespace
}  // namespace l4d::render
