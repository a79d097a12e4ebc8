// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/base/half.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

namespace l4d {
namespace {

float float_of_bits(uint32_t bits) {
  float value;
  std::memcpy(&value, &bits, sizeof(value));
  return value;
}

uint32_t bits_of_float(float value) {
  uint32_t bits;
  std::memcpy(&bits, &value, sizeof(bits));
  return bits;
}

uint16_t eigen_half(float value) {
  return Eigen::numext::bit_cast<uint16_t>(static_cast<Eigen::half>(value));
}

float eigen_float(uint16_t bits) {
  return static_cast<float>(Eigen::numext::bit_cast<Eigen::half>(bits));
}

bool is_nan(uint16_t half) { return (half & 0x7fffu) > kHalfInfinity; }

// One failure is enough: EXPECT in a loop of millions is slow.
::testing::AssertionResult same_as_oracle(uint32_t bits) {
  const float value = float_of_bits(bits);
  const uint16_t ours = float_to_half(value);
  const bool same = std::isnan(value) ? is_nan(ours) : ours == eigen_half(value);
  if (same) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << "bits " << bits << " value " << value << ": " << ours;
}

TEST(Half, ToFloatForAll) {
  for (uint32_t h = 0; h <= 0xffffu; ++h) {
    const uint16_t half = static_cast<uint16_t>(h);
    const float value = half_to_float(half);
    if (is_nan(half)) {
      ASSERT_TRUE(std::isnan(value));
    } else {
      ASSERT_EQ(bits_of_float(value), bits_of_float(eigen_float(half)));
    }
  }
}

TEST(Half, RoundTripForAll) {
  for (uint32_t h = 0; h <= 0xffffu; ++h) {
    const uint16_t half = static_cast<uint16_t>(h);
    const uint16_t back = float_to_half(half_to_float(half));
    if (is_nan(half)) {
      ASSERT_EQ(back, half | 0x200u);  // quiet, the payload kept
    } else {
      ASSERT_EQ(back, half);
    }
  }
}

TEST(Half, FromFloatSampled) {
  constexpr uint64_t kStride = 211;  // a prime, so that all low bits occur
  for (uint64_t bits = 0; bits <= 0xffffffffull; bits += kStride) {
    const auto result = same_as_oracle(static_cast<uint32_t>(bits));
    if (!result) FAIL() << result.message();
  }
}

// Every value between two halves that are next to each other, and the floats about it.
TEST(Half, FromFloatAboutTies) {
  for (uint32_t h = 0; h < kHalfInfinity; ++h) {
    const double low = half_to_float(static_cast<uint16_t>(h));
    const double high = h == kHalfMax ? 65536.0 : half_to_float(static_cast<uint16_t>(h + 1));
    const uint32_t tie = bits_of_float(static_cast<float>(low + (high - low) / 2));
    for (uint32_t sign : {0u, 0x80000000u}) {
      for (uint32_t offset = 0; offset < 5; ++offset) {
        const auto result = same_as_oracle(sign | (tie + offset - 2));
        if (!result) FAIL() << result.message();
      }
      const uint16_t even = static_cast<uint16_t>((h & 1) == 0 ? h : h + 1);
      ASSERT_EQ(float_to_half(float_of_bits(sign | tie)), (sign >> 16) | even);
    }
  }
}

TEST(Half, EndsOfTheRange) {
  EXPECT_EQ(float_to_half(65504.0f), kHalfMax);
  EXPECT_EQ(float_to_half(std::nextafter(65520.0f, 0.0f)), kHalfMax);
  EXPECT_EQ(float_to_half(65520.0f), kHalfInfinity);
  EXPECT_EQ(float_to_half(-1e30f), 0x8000u | kHalfInfinity);
  EXPECT_EQ(float_to_half(0x1p-24f), 1u);
  EXPECT_EQ(float_to_half(0x1p-25f), 0u);
  EXPECT_EQ(float_to_half(std::nextafter(0x1p-25f, 1.0f)), 1u);
  EXPECT_EQ(float_to_half(-0.0f), 0x8000u);
  EXPECT_EQ(float_to_half(std::numeric_limits<float>::denorm_min()), 0u);
}

TEST(Half, Saturation) {
  EXPECT_EQ(float_to_half_saturate(1.5f), float_to_half(1.5f));
  EXPECT_EQ(float_to_half_saturate(65519.0f), kHalfMax);
  EXPECT_EQ(float_to_half_saturate(65520.0f), kHalfMax);
  EXPECT_EQ(float_to_half_saturate(-1e30f), 0x8000u | kHalfMax);
  EXPECT_EQ(float_to_half_saturate(std::numeric_limits<float>::infinity()), kHalfMax);
  EXPECT_TRUE(is_nan(float_to_half_saturate(std::numeric_limits<float>::quiet_NaN())));
}

TEST(Half, ManyAtATimeAreAsOneAtATime) {
  std::vector<float> values;
  for (uint64_t bits = 0; bits <= 0xffffffffu; bits += 4093) {
    const auto pattern = static_cast<uint32_t>(bits);
    float value;
    std::memcpy(&value, &pattern, sizeof(value));
    if (!std::isnan(value)) values.push_back(value);
  }
  // Each half, and what lies halfway between two, where ties are.
  for (uint32_t half = 0; half < 0x10000; ++half) {
    const float value = half_to_float(static_cast<uint16_t>(half));
    const float next = half_to_float(static_cast<uint16_t>(half + 1));
    if (std::isnan(value) || std::isnan(next)) continue;
    for (const float v : {value, value / 2 + next / 2}) {
      if (!std::isnan(v)) values.push_back(v);
    }
  }
  std::vector<uint16_t> halves(values.size());
  floats_to_halves(values.data(), values.size(), halves.data());
  for (size_t k = 0; k < values.size(); ++k) {
    ASSERT_EQ(halves[k], float_to_half_saturate(values[k])) << values[k];
  }
  const float nan = std::numeric_limits<float>::quiet_NaN();
  floats_to_halves(&nan, 1, halves.data());
  EXPECT_EQ(halves[0], kHalfMax);
}

}  // namespace
}  // namespace l4d
