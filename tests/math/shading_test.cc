// SPDX-License-Identifier: Apache-2.0
// The formulas of sh.h and slice.h, which host and device share, against the table that tests of
// the other languages read.
#include <gtest/gtest.h>

#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

#include "libl4dcodec/scene/sh.h"
#include "libl4dcodec/scene/slice.h"
#include "tests/common/files.h"

namespace l4d {
namespace {

const nlohmann::json& table() {
  static const nlohmann::json kTable =
      nlohmann::json::parse(std::ifstream(test::source_file("spec/examples/shading.json")));
  return kTable;
}

template <typename T>
class Shading : public testing::Test {};
using Numbers = testing::Types<float, double>;
TYPED_TEST_SUITE(Shading, Numbers);

TYPED_TEST(Shading, Basis) {
  const auto& rows = table().at("sh");
  ASSERT_GE(rows.size(), 8u);
  for (const auto& row : rows) {
    const auto d = row.at("direction").get<std::vector<TypeParam>>();
    const auto expected = row.at("basis").get<std::vector<double>>();
    ASSERT_EQ(expected.size(), kMaxShTerms);
    for (uint32_t degree = 0; degree <= 3; ++degree) {
      std::vector<TypeParam> basis(sh_terms(degree));
      sh_basis(degree, d[0], d[1], d[2], basis.data());
      for (size_t k = 0; k < basis.size(); ++k) {
        EXPECT_NEAR(static_cast<double>(basis[k]), expected[k],
                    8 * static_cast<double>(std::numeric_limits<TypeParam>::epsilon()))
            << row << ", term " << k;
      }
    }
  }
}

TYPED_TEST(Shading, Falloff) {
  const auto& rows = table().at("falloff");
  ASSERT_GE(rows.size(), 28u);
  for (const auto& row : rows) {
    const auto lambda = row.at("lambda").get<TypeParam>(), dt = row.at("dt").get<TypeParam>();
    const auto expected = row.at("falloff").get<double>();
    EXPECT_EQ(is_visible(lambda, dt), row.at("visible").get<bool>()) << row;
    EXPECT_NEAR(static_cast<double>(falloff(lambda, dt)) / expected, 1,
                16 * static_cast<double>(std::numeric_limits<TypeParam>::epsilon()))
        << row;
  }
}

}  // namespace
}  // namespace l4d
