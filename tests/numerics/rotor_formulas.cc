// SPDX-License-Identifier: Apache-2.0
// Rotors: normalisation, the matrix, and its inverse.
#include <algorithm>
#include <cmath>

#include "libl4dcodec/math/rotor.h"
#include "tests/math/reference.h"
#include "tests/numerics/formula.h"

namespace l4d::numerics {
namespace {

using reference::Random;
using reference::Real;

constexpr int kCases = 100000;

// The halves by their definition, in long double.
template <typename T>
RotorHalves<Real> exact_halves(const T* rotor) {
  Real wide[8];
  for (int k = 0; k < 8; ++k) wide[k] = Real(rotor[k]);
  RotorHalves<Real> h = halves_of_rotor(wide);
  for (Real* half : {h.a, h.b}) {
    const Real norm =
        std::sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2] + half[3] * half[3]);
    for (int k = 0; k < 4; ++k) half[k] /= norm;
  }
  return h;
}

template <typename T>
double rotor_error(const T* out, const Real* expected) {
  Real worst = 0;
  for (int k = 0; k < 8; ++k) {
    const Real e = std::fabs(Real(out[k]) - expected[k]);
    worst = e <= worst ? worst : e;
  }
  return static_cast<double>(worst);
}

// The published correction of the constraint, as it is written, and the division by the norm. Where
// the violation is below 1e-7 the correction is left out.
template <typename T>
void naive_normalize(const T* r, T* out) {
  T l2 = 0;
  for (int k = 0; k < 8; ++k) l2 += r[k] * r[k];
  const T eps = r[kRotorS] * r[kRotorP] - r[kRotorB01] * r[kRotorB23] +
                r[kRotorB02] * r[kRotorB13] - r[kRotorB03] * r[kRotorB12];
  const bool valid = std::fabs(eps) <= static_cast<T>(1e-7);
  const T delta = valid ? 0 : (std::sqrt(l2 * l2 - 4 * eps * eps) - l2) / (2 * eps);
  const T o[8] = {r[0] + delta * r[7], r[1] - delta * r[6], r[2] + delta * r[5],
                  r[3] - delta * r[4], r[4] - delta * r[3], r[5] + delta * r[2],
                  r[6] - delta * r[1], r[7] + delta * r[0]};
  T norm2 = 0;
  for (int k = 0; k < 8; ++k) norm2 += o[k] * o[k];
  for (int k = 0; k < 8; ++k) out[k] = o[k] / std::sqrt(norm2);
}

template <typename T>
void trained_rotor(Random& random, int i, T* r) {
  static constexpr double kTemporal[4] = {1e-5, 1e-3, 0.05, 1.0};
  reference::random_rotor(random, kTemporal[i & 3], r);
}

// Two halves of any direction, |A| : |B| up to 1e5 : 1 either way.
void lopsided_rotor(Random& random, float* r) {
  double wide[8];
  reference::random_rotor(random, 1.0, wide);
  RotorHalves<double> h = normalized_halves(wide);
  const double ratio = random.log_uniform(1e-5, 1.0);
  double* shorter = random.uniform() < 0.5 ? h.a : h.b;
  for (int k = 0; k < 4; ++k) shorter[k] *= ratio;
  rotor_of_halves(h, wide);
  for (int k = 0; k < 8; ++k) r[k] = static_cast<float>(wide[k]);
}

template <typename T>
Observed normalize_trained() {
  Random random(101);
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    T r[8], out[8], naive[8];
    trained_rotor(random, i, r);
    const reference::Rotor t = reference::normalize(reference::load(r));
    const Real expected[8] = {t.s, t.b01, t.b02, t.b12, t.b03, t.b13, t.b23, t.p};
    normalize_rotor(r, out);
    naive_normalize(r, naive);
    o.add(rotor_error(out, expected));
    o.add_naive(rotor_error(naive, expected));
  }
  return o;
}

template <typename Make>
Observed normalize_against_halves(const Make& make) {
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    float r[8], out[8], naive[8];
    make(i, r);
    Real expected[8];
    rotor_of_halves(exact_halves(r), expected);
    normalize_rotor(r, out);
    naive_normalize(r, naive);
    o.add(rotor_error(out, expected));
    o.add_naive(rotor_error(naive, expected));
  }
  return o;
}

Observed normalize_lengths() {
  Random random(102);
  return normalize_against_halves([&](int i, float* r) {
    trained_rotor(random, i, r);
    const double length = random.log_uniform(1e-5, 1e14);
    for (int k = 0; k < 8; ++k) r[k] = static_cast<float>(static_cast<double>(r[k]) * length);
  });
}

Observed normalize_lopsided() {
  Random random(103);
  return normalize_against_halves([&](int, float* r) { lopsided_rotor(random, r); });
}

template <typename T>
double orthogonality_error(const T* m) {
  Real worst = 0;
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      Real sum = i == j ? -1 : 0;
      for (int k = 0; k < 4; ++k) sum += Real(m[4 * i + k]) * Real(m[4 * j + k]);
      worst = std::max(worst, std::fabs(sum));
    }
  }
  return static_cast<double>(worst);
}

Observed matrix_orthogonal() {
  Random random(104);
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    float r[8], m[16];
    if (i % 2 == 0)
      trained_rotor(random, i / 2, r);
    else
      lopsided_rotor(random, r);
    rotor_to_matrix(normalized_halves(r), m);
    o.add(orthogonality_error(m));
    // Eight numbers of length 1, without the constraint.
    float norm2 = 0, naive[16];
    for (int k = 0; k < 8; ++k) norm2 += r[k] * r[k];
    for (int k = 0; k < 8; ++k) r[k] /= std::sqrt(norm2);
    rotor_to_matrix(halves_of_rotor(r), naive);
    o.add_naive(orthogonality_error(naive));
  }
  return o;
}

Observed matrix_entries() {
  Random random(105);
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    float r[8], m[16];
    if (i % 2 == 0)
      trained_rotor(random, i / 2, r);
    else
      lopsided_rotor(random, r);
    rotor_to_matrix(normalized_halves(r), m);
    Real wide[8], expected[4][4];
    rotor_of_halves(exact_halves(r), wide);
    reference::matrix(reference::load(wide), expected);
    Real worst = 0;
    for (int k = 0; k < 16; ++k) {
      worst = std::max(worst, std::fabs(Real(m[k]) - expected[k / 4][k % 4]));
    }
    o.add(static_cast<double>(worst));
  }
  return o;
}

// Up to the sign of both.
double difference_of_rotors(const double* a, const double* b) {
  double same = 0, opposite = 0;
  for (int k = 0; k < 8; ++k) {
    same = std::max(same, std::fabs(a[k] - b[k]));
    opposite = std::max(opposite, std::fabs(a[k] + b[k]));
  }
  const double e = std::min(same, opposite);
  return std::isnan(a[0]) ? HUGE_VAL : e;
}

// As matrix_to_rotor, but with the first row of the products, whatever its length.
void naive_matrix_to_rotor(const double* m, double* rotor) {
  const double k0[4] = {(m[0] + m[5]) + (m[10] + m[15]), (m[1] - m[4]) + (m[11] - m[14]),
                        (m[2] - m[8]) - (m[7] - m[13]), (m[3] - m[12]) + (m[6] - m[9])};
  const double column[4] = {k0[0], (m[1] - m[4]) - (m[11] - m[14]), (m[2] - m[8]) + (m[7] - m[13]),
                            (m[6] - m[9]) - (m[3] - m[12])};
  RotorHalves<double> h;
  double a = 0, b = 0;
  for (int k = 0; k < 4; ++k) {
    a += column[k] * column[k];
    b += k0[k] * k0[k];
  }
  for (int k = 0; k < 4; ++k) {
    h.a[k] = column[k] / std::sqrt(a);
    h.b[k] = k0[k] / std::sqrt(b);
  }
  rotor_of_halves(h, rotor);
}

Observed matrix_round_trip() {
  Random random(106);
  Observed o;
  for (int i = 0; i < kCases; ++i) {
    double r[8], m[16], back[8], naive[8];
    RotorHalves<double> h;
    for (double* half : {h.a, h.b}) {
      for (int k = 0; k < 4; ++k) half[k] = random.normal();
      // First numbers that nearly or quite vanish: turns by half a circle.
      if (i % 3 == 1) half[0] *= random.log_uniform(1e-16, 1.0);
      if (i % 3 == 2) half[i / 3 % 4] = 0;
      normalize_half(half);
    }
    rotor_of_halves(h, r);
    rotor_to_matrix(normalized_halves(r), m);
    matrix_to_rotor(m, back);
    naive_matrix_to_rotor(m, naive);
    o.add(difference_of_rotors(back, r));
    o.add_naive(difference_of_rotors(naive, r));
  }
  return o;
}

constexpr char kTrained[] = "rotors with temporal parts of 1e-5 to 1";

std::vector<Formula> list() {
  static constexpr char kSix[] =
      "per half: 1 rounding of a sum, 2 of a squared length (half of which the root keeps), the "
      "root, the division; then one sum";
  static constexpr char kSplit[] = "the published correction with its division by the violation";
  return {
      {"rotor_normalize_float", "normalize_rotor<float>", "published formula, long double",
       kTrained, "largest error of a coefficient", kSix, kSplit, 6 * kU32,
       normalize_trained<float>},
      {"rotor_normalize_double", "normalize_rotor<double>", "published formula, long double",
       kTrained, "largest error of a coefficient", kSix, kSplit, 6 * kU64,
       normalize_trained<double>},
      {"rotor_normalize_lengths", "normalize_rotor<float>", "two quaternions, long double",
       "lengths of 1e-5 to 1e14", "largest error of a coefficient", kSix, kSplit, 6 * kU32,
       normalize_lengths},
      {"rotor_normalize_lopsided", "normalize_rotor<float>", "two quaternions, long double",
       "off the constraint: one half 1 to 1e5 times as long as the other",
       "largest error of a coefficient", kSix, kSplit, 6 * kU32, normalize_lopsided},
      {"rotor_matrix_float", "rotor_to_matrix<float>", "quadratic polynomials, long double",
       "as rotor_normalize_float and _lopsided", "largest error of an entry",
       "two halves of 4.5 roundings each, the product, two sums", "", 12 * kU32, matrix_entries},
      {"rotor_matrix_orthogonal", "rotor_to_matrix<float>", "identity, products in long double",
       "as rotor_normalize_float and _lopsided", "largest entry of R R^T - I",
       "twice that of an entry", "division by the norm of all eight numbers", 24 * kU32,
       matrix_orthogonal},
      {"rotor_matrix_round_trip", "matrix_to_rotor(rotor_to_matrix)", "the rotor",
       "halves of any direction, numbers of them down to 1e-16 and 0",
       "largest error of a coefficient", "16 entries of 3 roundings, averaged; two normalisations",
       "first row of the products", 8 * kU64, matrix_round_trip},
  };
}
const Register kRegister(list);

}  // namespace
}  // namespace l4d::numerics
