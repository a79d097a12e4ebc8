// SPDX-License-Identifier: Apache-2.0
// Slicing: covariance, speed, visibility and falloff, of rows that are given.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/slice.h"
#include "tests/math/reference.h"
#include "tests/numerics/formula.h"

namespace l4d::numerics {
namespace {

using reference::Random;
using reference::Real;

constexpr int kCases = 50000;

struct Rows {
  float narrow[16];
  Real wide[16];
};

Rows make_rows(const float* rotor, const float* scale) {
  Rows r;
  scaled_rows(normalized_halves(rotor), scale, r.narrow);
  for (int k = 0; k < 16; ++k) r.wide[k] = Real(r.narrow[k]);
  return r;
}

// Log scales anywhere in what a scene may hold, each for itself; temporal parts from none to 1.
Rows any_rows(Random& random, int i) {
  static constexpr double kTemporal[4] = {0, 1e-4, 0.05, 1.0};
  float rotor[8], scale[4];
  reference::random_rotor(random, kTemporal[i & 3], rotor);
  for (float& s : scale) s = static_cast<float>(std::exp(random.uniform(-16.0, 16.0)));
  return make_rows(rotor, scale);
}

Real norm2(const Real* row) {
  return row[0] * row[0] + row[1] * row[1] + row[2] * row[2] + row[3] * row[3];
}

// What the slice is defined as, with the floor of the temporal variance. *ratio: how much longer
// the part of the rows along m_t is than the rest of them.
void exact_covariance(const Rows& r, Real* covariance, Real* ratio) {
  const Real* t = r.wide + 12;
  const Real variance = std::max(norm2(t), Real(kMinTemporalVariance));
  Real p[3][4], along = 0;
  for (int i = 0; i < 3; ++i) {
    const Real* m = r.wide + 4 * i;
    Real v = 0;
    for (int k = 0; k < 4; ++k) v += m[k] * t[k] / variance;
    for (int k = 0; k < 4; ++k) p[i][k] = m[k] - v * t[k];
    along += v * v * norm2(t);
  }
  int n = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      covariance[n] = 0;
      for (int k = 0; k < 4; ++k) covariance[n] += p[i][k] * p[j][k];
      ++n;
    }
  }
  // Without the floor the minors have no cancellation at all.
  if (norm2(t) >= Real(kMinTemporalVariance)) reference::minors(r.wide, covariance);
  *ratio = std::sqrt(along / (covariance[0] + covariance[3] + covariance[5]));
}

Observed covariance_any() {
  Random random(111);
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    const Rows r = any_rows(random, i);
    Real expected[6], ratio;
    exact_covariance(r, expected, &ratio);
    const double left = static_cast<double>(ratio) * kU32;
    const double unit = kU32 + left * left;
    const Slice4D<float> s = slice_rows(r.narrow);
    o.add(reference::relative_error6(s.covariance, expected) / unit);
    float velocity[3], lambda, naive[6];
    reference::schur(r.narrow, velocity, &lambda, naive);
    // It has no floor.
    if (norm2(r.wide + 12) < Real(kMinTemporalVariance)) continue;
    o.add_naive(reference::relative_error6(naive, expected) / unit);
  }
  return o;
}

// How negative a covariance can be, as a share of its trace.
template <typename T>
double negative_share(const T* c) {
  Eigen::Matrix3d m;
  const double d[6] = {double(c[0]), double(c[1]), double(c[2]),
                       double(c[3]), double(c[4]), double(c[5])};
  m << d[0], d[1], d[2], d[1], d[3], d[4], d[2], d[4], d[5];
  const double trace = m.trace();
  if (!(trace > 0)) return trace == 0 ? 0 : HUGE_VAL;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m / trace, Eigen::EigenvaluesOnly);
  return std::max(0.0, -solver.eigenvalues()[0]);
}

Observed covariance_sign() {
  Random random(112);
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    const Rows r = any_rows(random, i);
    o.add(negative_share(slice_rows(r.narrow).covariance));
    float velocity[3], lambda, naive[6];
    reference::schur(r.narrow, velocity, &lambda, naive);
    o.add_naive(negative_share(naive));
  }
  return o;
}

Observed lambda_any() {
  Random random(113);
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    const Rows r = any_rows(random, i);
    const Real floor = kMinTemporalVariance;
    const Real expected = 1 / std::max(norm2(r.wide + 12), floor);
    const Real got = slice_rows(r.narrow).lambda;
    o.add(static_cast<double>(std::fabs(got - expected) / expected));
  }
  return o;
}

Observed velocity_any() {
  Random random(114);
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    const Rows r = any_rows(random, i);
    const Real* t = r.wide + 12;
    const Real variance = std::max(norm2(t), Real(kMinTemporalVariance));
    const Slice4D<float> s = slice_rows(r.narrow);
    for (int k = 0; k < 3; ++k) {
      const Real* m = r.wide + 4 * k;
      Real dot = 0;
      for (int j = 0; j < 4; ++j) dot += m[j] * t[j];
      const Real unit = std::sqrt(norm2(m) * norm2(t)) / variance;
      o.add(static_cast<double>(std::fabs(Real(s.velocity[k]) - dot / variance) / unit));
    }
  }
  return o;
}

// Temporal scales of 1 us to 2.5 h, anywhere inside the gate.
Observed falloff() {
  Random random(115);
  Observed o;
  for (int i = 0; i < 4 * kCases; ++i) {
    const double sigma = random.log_uniform(1e-6, 9000.0);
    const float lambda = static_cast<float>(1 / (sigma * sigma));
    const float dt = static_cast<float>(sigma * random.uniform(-4.0, 4.0));
    const float got = std::exp(-0.5f * (lambda * (dt * dt)));
    const Real expected = std::exp(-Real(lambda) * Real(dt) * Real(dt) / 2);
    o.add(static_cast<double>(std::fabs(Real(got) - expected)));
  }
  return o;
}

// Where on either side of the gate a Gaussian appears, against where it should.
Observed gate() {
  Random random(116);
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    const double sigma = random.log_uniform(1e-6, 9000.0);
    const float lambda = static_cast<float>(1 / (sigma * sigma));
    const Real exact = 4 / std::sqrt(Real(lambda));
    float dt = static_cast<float>(exact) * (1 - 8 * static_cast<float>(kU32));
    while (is_visible(lambda, dt)) dt = std::nextafter(dt, HUGE_VALF);
    o.add(static_cast<double>(std::fabs(Real(dt) - exact) / exact));
  }
  return o;
}

std::vector<Formula> list() {
  static constexpr char kAny[] = "every log scale in -16..16, temporal parts of 0 to 1";
  return {
      {"slice_covariance", "slice_rows<float>", "2 x 2 minors, long double", kAny,
       "relative error (Frobenius) in units of u + (u r)^2, r = length along m_t : length left",
       "8 roundings of p = m - v m_t and 5 of a product; what cancels leaves u r across, squared",
       "Schur complement in binary32", 16, covariance_any},
      {"slice_covariance_sign", "slice_rows<float>", "eigenvalues in binary64", kAny,
       "most negative eigenvalue : trace", "each entry is off by 4 roundings of p . p",
       "Schur complement in binary32", 4 * kU32, covariance_sign},
      {"slice_lambda", "slice_rows<float>", "long double", kAny, "relative error",
       "a product, two sums, a division", "", 4 * kU32, lambda_any},
      {"slice_velocity", "slice_rows<float>", "long double", kAny,
       "error : |m_i| |m_t| lambda, which |v_i| cannot exceed",
       "3 roundings of the product, 4 of lambda, 1", "", 8 * kU32, velocity_any},
      {"slice_falloff", "exp(-lambda dt^2 / 2) in binary32", "long double",
       "temporal scales of 1 us to 2.5 h, within the gate", "absolute error",
       "2 roundings of the exponent x, of which x e^-x <= 0.37 counts; exp itself", "", 3 * kU32,
       falloff},
      {"slice_gate", "is_visible<float>", "4 / sqrt(lambda), long double",
       "temporal scales of 1 us to 2.5 h", "relative error of the time of appearance",
       "2 roundings of lambda dt^2, halved by the root; one step of dt", "", 4 * kU32, gate},
  };
}
const Register kRegister(list);

}  // namespace
}  // namespace l4d::numerics
