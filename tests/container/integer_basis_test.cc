// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/quant/integer_basis.h"

#include <gtest/gtest.h>

#include <cmath>

#include "libl4dcodec/base/half.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

TEST(IntegerBasis, IsTheBasisTimesStepsToHalfAUnit) {
  test::Random random(5);
  constexpr size_t kDim = 48, kCoefficients = 45;
  for (const float size : {0x1p-20f, 1.0f, 0x1p10f}) {
    std::vector<float> basis, steps;
    for (size_t i = 0; i < kDim * (kCoefficients + 1); ++i) {
      basis.push_back(half_to_float(float_to_half(random.uniformf(-1, 1))));
    }
    for (size_t k = 0; k < kCoefficients; ++k) steps.push_back(size * random.uniformf(0.5, 1));
    const IntegerBasis m = integer_basis(basis.data(), kDim, steps.data(), kCoefficients);
    int largest = 0;
    for (size_t i = 0; i < m.vectors.size(); ++i) {
      const double w = static_cast<double>(basis[kDim + i] * steps[i / kDim]);
      const double scale = static_cast<double>(m.scale);
      // 32767 stands for all above.
      const double off = std::fabs(w - m.vectors[i] * scale);
      EXPECT_LE(off, (std::abs(m.vectors[i]) == 32767 ? 1.0 : 0.5) * scale) << i;
      largest = std::max(largest, std::abs(int{m.vectors[i]}));
    }
    EXPECT_GE(largest, 16384);
    EXPECT_EQ(std::frexp(m.scale, &largest), 0.5f);
  }
}

// By hand: the largest product is 1.5, below 2^1, so that a unit is 2^-14; ties go to even
// integers.
TEST(IntegerBasis, RoundsTiesToEven) {
  const float basis[] = {9, 9, 9, 3, 0x1p-14f, -3, 0x1.8p-14f, 0x1.4p-13f, -0x1.cp-13f};
  const float steps[] = {0.5f, 1};
  const IntegerBasis m = integer_basis(basis, 3, steps, 2);
  EXPECT_EQ(m.scale, 0x1p-14f);
  EXPECT_EQ(m.vectors, (std::vector<int16_t>{24576, 0, -24576, 2, 2, -4}));
}

TEST(IntegerBasis, EndsAtTheLargestInteger) {
  const float basis[] = {0, 0x1.fffffep0f, -0x1.fffffep0f};
  const float step = 1;
  const float one[] = {0, 0x1.fffffep0f};
  EXPECT_EQ(integer_basis(one, 1, &step, 1).vectors, std::vector<int16_t>{32767});
  const float two[] = {1, 1};
  EXPECT_EQ(integer_basis(basis, 1, two, 2).vectors, (std::vector<int16_t>{32767, -32767}));
}

TEST(IntegerBasis, OfZerosIsZeros) {
  const float basis[] = {5, 0, -0.0f};
  const float steps[] = {1, 1};
  const IntegerBasis m = integer_basis(basis, 1, steps, 2);
  EXPECT_EQ(m.vectors, (std::vector<int16_t>{0, 0}));
  EXPECT_EQ(m.scale, 1);
}

}  // namespace
}  // namespace l4d
