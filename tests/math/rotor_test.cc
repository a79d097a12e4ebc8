// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/math/rotor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iostream>

#include "tests/math/reference.h"

namespace l4d {
namespace {

using reference::Random;
using reference::Real;

constexpr int kCases = 200000;

double max_difference(const Real (*a)[4], const double* b) {
  double worst = 0;
  for (int i = 0; i < 16; ++i) {
    worst = std::max(worst, std::fabs(static_cast<double>(a[i / 4][i % 4] - Real(b[i]))));
  }
  return worst;
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

template <typename T>
double error_to_textbook(const T* in, const T* out) {
  const reference::Rotor r = reference::normalize(reference::load(in));
  const Real expected[8] = {r.s, r.b01, r.b02, r.b12, r.b03, r.b13, r.b23, r.p};
  Real worst = 0;
  for (int i = 0; i < 8; ++i) worst = std::max(worst, std::fabs(Real(out[i]) - expected[i]));
  return static_cast<double>(worst);
}

// Random rotors over the range codecs meet: nearly valid ones, and eight unrelated numbers.
template <typename T>
void random_case(Random& random, int i, T* r) {
  static constexpr double kTemporal[4] = {1e-5, 1e-3, 0.05, 1.0};
  reference::random_rotor(random, kTemporal[i & 3], r);
}

template <typename T>
void normalization_agrees_with_textbook(double bound, double orthogonality_bound) {
  Random random(1);
  double worst = 0, worst_orthogonality = 0;
  for (int i = 0; i < kCases; ++i) {
    T r[8], out[8], m[16];
    random_case(random, i, r);
    normalize_rotor(r, out);
    worst = std::max(worst, error_to_textbook(r, out));
    rotor_to_matrix(normalized_halves(r), m);
    worst_orthogonality = std::max(worst_orthogonality, orthogonality_error(m));
  }
  std::cout << "normalisation, " << sizeof(T) * 8 << " bit: max error " << worst
            << ", max |R R^T - I| " << worst_orthogonality << "\n";
  EXPECT_LT(worst, bound);
  EXPECT_LT(worst_orthogonality, orthogonality_bound);
}

TEST(Rotor, NormalizationAgreesWithTextbookInDouble) {
  normalization_agrees_with_textbook<double>(2e-15, 2e-15);
}

TEST(Rotor, NormalizationAgreesWithTextbookInFloat) {
  normalization_agrees_with_textbook<float>(1e-6, 1e-6);
}

TEST(Rotor, DividingByTheNormAloneGivesNoRotation) {
  Random random(2);
  double sum = 0;
  constexpr int kRuns = 2000;
  for (int i = 0; i < kRuns; ++i) {
    double r[8], norm2 = 0;
    for (double& c : r) c = random.normal();
    for (const double c : r) norm2 += c * c;
    for (double& c : r) c /= std::sqrt(norm2);
    Real m[4][4];
    reference::matrix(reference::load(r), m);
    double narrow[16];
    for (int k = 0; k < 16; ++k) narrow[k] = static_cast<double>(m[k / 4][k % 4]);
    sum += orthogonality_error(narrow);
  }
  EXPECT_GT(sum / kRuns, 0.1);
}

struct Golden {
  uint32_t in[8];
  uint32_t out[8];
};

// Outputs of an independent program that rounds every operation to binary32 in the specified order.
// The decoded bitstream depends on each of these bits.
constexpr Golden kGolden[] = {
    {{0x3f800000, 0x00000000, 0x00000000, 0x00000000, 0x00000000, 0x00000000, 0x00000000,
      0x00000000},
     {0x3f800000, 0x00000000, 0x00000000, 0x00000000, 0x00000000, 0x00000000, 0x00000000,
      0x00000000}},
    {{0x3dcccccd, 0x3dcccccd, 0x3dcccccd, 0x3dcccccd, 0x3dcccccd, 0x3dcccccd, 0x3dcccccd,
      0x3dcccccd},
     {0x3eb504f3, 0x3eb504f3, 0x3eb504f3, 0x3eb504f3, 0x3eb504f3, 0x3eb504f3, 0x3eb504f3,
      0x3eb504f3}},
    {{0xbe8302be, 0x3f02ed2d, 0xbe6785c1, 0xbea150a6, 0xbd3e77bd, 0xbc2ebca9, 0x3d63b87e,
      0x3cadbb01},
     {0xbebd949e, 0x3f3cfbd6, 0xbea9a0c4, 0xbee7f778, 0xbcc12d18, 0xbd41c98c, 0x3c17dfa0,
      0xbba3e800}},
    {{0x3f84b874, 0x3e7ee05b, 0x3eca1f3f, 0x3e3dc646, 0xbdaa9ad4, 0x3d2f27c8, 0x3ccf6a4d,
      0x3ccc50dd},
     {0x3f65d7fe, 0x3e5dc67c, 0x3eae7153, 0x3e219b19, 0xbd87154a, 0x3cc2b7d0, 0x3cf86d78,
      0xbc59e300}},
    {{0xbfd87ea2, 0xbfdf37ba, 0xbf63bdd5, 0xbeefb681, 0x3c7a38ab, 0xbb16718d, 0x3cd5642d,
      0xbd038799},
     {0xbf24ad1f, 0xbf29cd0a, 0xbead46a6, 0xbe364c48, 0x3b44d420, 0x3b922460, 0xba0ec600,
      0xbb081b00}},
    {{0x3e9e0e57, 0x3ec9ce9e, 0xbf29404c, 0x3fdbd809, 0x3ce3fcb9, 0x3d75258c, 0xbcfe169f,
      0xbd1773ee},
     {0x3e2541e0, 0x3e53fff4, 0xbeb115fe, 0x3f666d80, 0xbbdf1840, 0x3cbd9178, 0xbcad7104,
      0xbc7e9838}},
    {{0xbeb026e3, 0xbdd9f36d, 0x3f21cfea, 0x3e7e63b7, 0xbfabc8c7, 0xc037ba27, 0xbfc7e81c,
      0x406a6ab9},
     {0x3c4c31e0, 0x3c59b030, 0x3d7dd570, 0x3da129d6, 0xbe8acf60, 0xbf0de8be, 0xbe9d1484,
      0x3f37aa4c}},
    {{0xbf4ed594, 0x3e7aa209, 0x3eda60b2, 0xbfbeafe7, 0x3e14e9c9, 0x407acc7c, 0xc0c16101,
      0xbf76fbed},
     {0xbdcb3a80, 0xbce32820, 0x3c947880, 0xbe4c2c0a, 0x3b97e510, 0x3f062777, 0xbf4ff12e,
      0xbdf9c2ac}},
    // One half is zero.
    {{0x3f000000, 0x3e800000, 0xbf400000, 0x3e000000, 0x3e000000, 0x3f400000, 0x3e800000,
      0xbf000000},
     {0x3f43d0e9, 0x3e07a1d2, 0xbecb72bc, 0x3d87a1d2, 0x3d87a1d2, 0x3ecb72bc, 0x3e07a1d2,
      0x3e70bc5c}},
    // Both halves are below the smallest length, and just above it.
    {{0x33d6bf95, 0x3456bf95, 0x34a10fb0, 0x34d6bf95, 0x33d6bf95, 0x33d6bf95, 0x33d6bf95,
      0x33d6bf95},
     {0x3f800000, 0x00000000, 0x00000000, 0x00000000, 0x00000000, 0x00000000, 0x00000000,
      0x00000000}},
    {{0x34a10fb0, 0x35210fb0, 0x35719787, 0x35a10fb0, 0x34a10fb0, 0xb4a10fb0, 0x34a10fb0,
      0x34a10fb0},
     {0x3e715bef, 0x3ea8f38e, 0x3f04bf5c, 0x3f3504f3, 0x00000000, 0xbd41165c, 0x3dc11659,
      0x3e715bef}},
};

TEST(Rotor, NormalizationIsBitExact) {
  for (const Golden& golden : kGolden) {
    float in[8];
    uint32_t out[8];
    std::memcpy(in, golden.in, sizeof(in));
    normalize_rotor(in, in);  // in place, as decoders do
    std::memcpy(out, in, sizeof(out));
    for (int i = 0; i < 8; ++i) {
      EXPECT_EQ(out[i], golden.out[i]) << "case " << (&golden - kGolden) << ", coefficient " << i;
    }
  }
}

TEST(Rotor, ScaleIsFree) {
  Random random(3);
  for (int i = 0; i < 1000; ++i) {
    float r[8], scaled[8], a[8], b[8];
    random_case(random, i, r);
    for (int k = 0; k < 8; ++k) scaled[k] = r[k] * 0.125f;
    normalize_rotor(r, a);
    normalize_rotor(scaled, b);
    EXPECT_EQ(std::memcmp(a, b, sizeof(a)), 0);
  }
}

TEST(Rotor, DegenerateHalfBecomesIdentity) {
  const double q[4] = {0.5, -0.5, 0.5, 0.5};
  RotorHalves<double> h{{1e-7, 0, -1e-8, 0}, {2 * q[0], 2 * q[1], 2 * q[2], 2 * q[3]}};
  double rotor[8];
  rotor_of_halves(h, rotor);
  h = normalized_halves(rotor);
  EXPECT_EQ(h.a[0], 1.0);
  EXPECT_EQ(h.a[1], 0.0);
  EXPECT_EQ(h.a[2], 0.0);
  EXPECT_EQ(h.a[3], 0.0);
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(h.b[i], q[i], 1e-7);

  const float zero[8] = {};
  float out[8];
  normalize_rotor(zero, out);
  const float identity[8] = {1, 0, 0, 0, 0, 0, 0, 0};
  EXPECT_EQ(std::memcmp(out, identity, sizeof(out)), 0);
}

TEST(Rotor, MatrixAgreesWithPolynomials) {
  Random random(4);
  double worst = 0, worst_float = 0;
  for (int i = 0; i < kCases; ++i) {
    double r[8], m[16];
    float rf[8], mf[16], unit[8];
    Real expected[4][4];
    random_case(random, i, r);
    normalize_rotor(r, r);
    reference::matrix(reference::load(r), expected);
    rotor_to_matrix(halves_of_rotor(r), m);
    worst = std::max(worst, max_difference(expected, m));
    for (int k = 0; k < 8; ++k) rf[k] = static_cast<float>(r[k]);
    normalize_rotor(rf, unit);
    reference::matrix(reference::normalize(reference::load(rf)), expected);
    rotor_to_matrix(halves_of_rotor(unit), mf);
    for (int k = 0; k < 16; ++k) m[k] = static_cast<double>(mf[k]);
    worst_float = std::max(worst_float, max_difference(expected, m));
  }
  std::cout << "matrix: max error " << worst << " (double), " << worst_float << " (float)\n";
  EXPECT_LT(worst, 2e-15);
  EXPECT_LT(worst_float, 1e-6);
}

TEST(Rotor, StaticRotorLeavesTimeAlone) {
  Random random(5);
  for (int i = 0; i < 1000; ++i) {
    float r[8], m[16];
    reference::random_rotor(random, 0.0, r);
    rotor_to_matrix(normalized_halves(r), m);
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(m[4 * k + 3], 0.0f);
      EXPECT_EQ(m[12 + k], 0.0f);
    }
    EXPECT_NEAR(m[15], 1.0f, 3e-7f);
    // The spatial block is the rotation of the quaternion w = s, x = -b12, y = b02, z = -b01.
    const Real w = r[0], x = -r[3], y = r[2], z = -r[1];
    const Real n = w * w + x * x + y * y + z * z;
    EXPECT_NEAR(m[0], static_cast<float>(1 - 2 * (y * y + z * z) / n), 5e-7f);
    EXPECT_NEAR(m[1], static_cast<float>(2 * (x * y - w * z) / n), 5e-7f);
    EXPECT_NEAR(m[2], static_cast<float>(2 * (x * z + w * y) / n), 5e-7f);
    EXPECT_NEAR(m[6], static_cast<float>(2 * (y * z - w * x) / n), 5e-7f);
  }
}

TEST(Rotor, MatrixToRotorAndBack) {
  Random random(6);
  double worst = 0;
  for (int i = 0; i < kCases; ++i) {
    double r[8], m[16], back[8];
    random_case(random, i, r);
    normalize_rotor(r, r);
    rotor_to_matrix(halves_of_rotor(r), m);
    matrix_to_rotor(m, back);
    ASSERT_GE(back[kRotorS], 0.0);
    const double sign = r[kRotorS] < 0 ? -1.0 : 1.0;
    for (int k = 0; k < 8; ++k) worst = std::max(worst, std::fabs(back[k] - sign * r[k]));
  }
  std::cout << "rotor -> matrix -> rotor: max error " << worst << "\n";
  EXPECT_LT(worst, 2e-15);
}

// All 192 signed permutations of determinant +1: every way for coefficients to vanish.
TEST(Rotor, MatrixToRotorOnAllSignedPermutations) {
  int axis[4] = {0, 1, 2, 3};
  int count = 0;
  do {
    int inversions = 0;
    for (int i = 0; i < 4; ++i) {
      for (int j = i + 1; j < 4; ++j) inversions += axis[i] > axis[j] ? 1 : 0;
    }
    for (int signs = 0; signs < 16; ++signs) {
      int negatives = inversions;
      double m[16] = {};
      for (int i = 0; i < 4; ++i) {
        const bool negative = ((signs >> i) & 1) != 0;
        negatives += negative ? 1 : 0;
        m[4 * i + axis[i]] = negative ? -1.0 : 1.0;
      }
      if (negatives % 2 != 0) continue;
      double rotor[8], back[16];
      matrix_to_rotor(m, rotor);
      rotor_to_matrix(normalized_halves(rotor), back);
      for (int k = 0; k < 16; ++k) ASSERT_NEAR(back[k], m[k], 1e-15);
      ++count;
    }
  } while (std::next_permutation(axis, axis + 4));
  EXPECT_EQ(count, 192);
}

}  // namespace
}  // namespace l4d
