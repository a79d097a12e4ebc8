// SPDX-License-Identifier: Apache-2.0
// Rotors that have no direction, or hardly one: what the specification says they become, exactly.
#include "libl4dcodec/math/rotor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "libl4dcodec/scene/slice.h"
#include "tests/common/flush_to_zero.h"
#include "tests/math/reference.h"

namespace l4d::numerics {
namespace {

using reference::Random;
using reference::Real;

const float kDenormal = std::numeric_limits<float>::denorm_min();

void expect_rotor(const float* got, const std::vector<float>& want) {
  for (size_t k = 0; k < 8; ++k) EXPECT_EQ(got[k], want[k]) << k;
}

TEST(RotorWithoutDirection, IsTheIdentity) {
  for (const float size : {0.0f, -0.0f, kDenormal, 1e-38f, 1e-20f, 2.4e-7f}) {
    float rotor[8], out[8];
    for (float& c : rotor) c = size;
    normalize_rotor(rotor, out);
    expect_rotor(out, {1, 0, 0, 0, 0, 0, 0, 0});
  }
}

// Whatever the other half is, it keeps its direction, and the result is a rotation.
TEST(RotorWithoutDirection, OneHalfAlone) {
  Random random(171);
  for (int i = 0; i < 20000; ++i) {
    RotorHalves<double> h;
    for (int k = 0; k < 4; ++k) h.a[k] = h.b[k] = random.normal();
    double* missing = i % 2 == 0 ? h.a : h.b;
    const double size = i % 3 == 0 ? 0 : std::pow(10.0, random.uniform(-45.0, -7.0));
    for (int k = 0; k < 4; ++k) missing[k] *= size;
    double wide[8];
    rotor_of_halves(h, wide);
    float rotor[8], out[8], matrix[16];
    for (int k = 0; k < 8; ++k) rotor[k] = static_cast<float>(wide[k]);
    const RotorHalves<float> raw = halves_of_rotor(rotor);
    const float* lost = i % 2 == 0 ? raw.a : raw.b;
    // Its residual after rounding to binary32 may be longer than the limit.
    if (dot4(lost, lost) >= kMinHalfNorm2) continue;
    normalize_rotor(rotor, out);
    const RotorHalves<float> unit = normalized_halves(rotor);
    const float* filled = i % 2 == 0 ? unit.a : unit.b;
    const float* kept = i % 2 == 0 ? unit.b : unit.a;
    const float fallback[4] = {1, 0, 0, 0};
    ASSERT_EQ(std::memcmp(filled, fallback, sizeof fallback), 0);
    ASSERT_NEAR(dot4(kept, kept), 1, 1e-6);
    rotor_to_matrix(unit, matrix);
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c) {
        ASSERT_NEAR(dot4(matrix + 4 * r, matrix + 4 * c), r == c ? 1 : 0, 1e-6);
      }
    }
  }
}

// On either side of the limit the same numbers give a direction or none.
TEST(RotorWithoutDirection, LimitIsSharp) {
  const float at = std::sqrt(kMinHalfNorm2);
  int kept = 0, lost = 0;
  for (int step = -8; step <= 8; ++step) {
    float half[4] = {0, at * (1 + static_cast<float>(step) * 0x1p-22f), 0, 0};
    const bool below = half[1] * half[1] < kMinHalfNorm2;
    normalize_half(half);
    EXPECT_EQ(half[0], below ? 1.0f : 0.0f);
    EXPECT_EQ(half[1], below ? 0.0f : 1.0f);
    ++(below ? lost : kept);
  }
  EXPECT_GT(kept, 3);
  EXPECT_GT(lost, 3);
}

// Denormal coefficients beside ordinary ones are rounded away, flushed or not.
TEST(RotorWithoutDirection, DenormalsDoNotMatter) {
  if (!test::FlushToZero::kAvailable) GTEST_SKIP() << "no flush-to-zero on this machine";
  Random random(172);
  for (int i = 0; i < 20000; ++i) {
    float rotor[8], plain[8], flushed[8];
    reference::random_rotor(random, 0.05, rotor);
    for (int k = 0; k < 3; ++k) {
      rotor[random.below(8)] = static_cast<float>(random.below(100)) * kDenormal;
    }
    normalize_rotor(rotor, plain);
    {
      const test::FlushToZero scope;
      normalize_rotor(rotor, flushed);
    }
    for (int k = 0; k < 8; ++k) {
      // Only a result that is itself below the normal numbers may become zero.
      if (std::fabs(plain[k]) >= std::numeric_limits<float>::min()) {
        ASSERT_EQ(plain[k], flushed[k]);
      } else {
        // It may also be a copy of the input, which no instruction flushes.
        ASSERT_TRUE(flushed[k] == 0 || flushed[k] == plain[k]) << flushed[k];
      }
    }
  }
}

}  // namespace
}  // namespace l4d::numerics
