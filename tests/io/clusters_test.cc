// SPDX-License-Identifier: Apache-2.0
#include "io/formats/clusters.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/math/reference.h"

namespace l4d::io {
namespace {

TEST(CodebookOf, FewValuesAreKept) {
  const std::vector<float> values = {3, -1.5F, 3, 0.25F, 100, -7};
  const std::vector<float> book = codebook_of(values);
  ASSERT_EQ(book.size(), 256U);
  EXPECT_TRUE(std::is_sorted(book.begin(), book.end()));
  for (const float x : values) EXPECT_EQ(book[nearest_code(book, x)], x);
  EXPECT_EQ(codebook_of({2}), std::vector<float>(256, 2.0F));
  EXPECT_EQ(codebook_of({}), std::vector<float>(256, 0.0F));
}

TEST(CodebookOf, ManyValuesAreNearACode) {
  reference::Random random(3);
  std::vector<float> values;
  for (int k = 0; k < 20000; ++k) values.push_back(static_cast<float>(random.normal()));
  values.push_back(40);
  const std::vector<float> book = codebook_of(values);
  double squares = 0;
  for (const float x : values) {
    const float error = std::fabs(book[nearest_code(book, x)] - x);
    for (const float code : book) ASSERT_LE(error, std::fabs(code - x) * 1.000001F);
    ASSERT_LT(error, 0.5F);
    squares += static_cast<double>(error) * static_cast<double>(error);
  }
  // 256 equal steps from -4 to 4 would have 8 / 256 / sqrt(12).
  EXPECT_LT(std::sqrt(squares / static_cast<double>(values.size())), 8.0 / 256 / std::sqrt(12.0));
}

TEST(NearestCode, IsTheNearerNeighbour) {
  const std::vector<float> book = {-1, 0, 4};
  EXPECT_EQ(nearest_code(book, -9), 0);
  EXPECT_EQ(nearest_code(book, -0.4F), 1);
  EXPECT_EQ(nearest_code(book, 1.9F), 1);
  EXPECT_EQ(nearest_code(book, 2.1F), 2);
  EXPECT_EQ(nearest_code(book, 9), 2);
}

TEST(PaletteOf, DividesWhatLiesApart) {
  // Three groups of two rows around (0, 0), (10, 0) and (40, 2).
  const std::vector<float> rows = {0, 1, 10, 1, 40, 3, 0, -1, 10, -1, 40, 1};
  const RowPalette palette = palette_of(rows, 2, 3);
  ASSERT_EQ(palette.centroids.size(), 6U);
  ASSERT_EQ(palette.labels.size(), 6U);
  const float expected[3][2] = {{0, 0}, {10, 0}, {40, 2}};
  for (size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(palette.labels[i], palette.labels[i % 3]);
    for (size_t j = 0; j < 2; ++j) {
      EXPECT_EQ(palette.centroids[2 * palette.labels[i] + j], expected[i % 3][j]) << i;
    }
  }
}

TEST(PaletteOf, HasNoMoreRowsThanThereAre) {
  const std::vector<float> equal(50, 0.1F);
  EXPECT_EQ(palette_of(equal, 5, 8).centroids.size(), 5U);
  const std::vector<float> rows = {1, 2, 3, 4};
  const RowPalette palette = palette_of(rows, 1, 1000);
  ASSERT_EQ(palette.centroids.size(), 4U);
  for (size_t i = 0; i < 4; ++i) EXPECT_EQ(palette.centroids[palette.labels[i]], rows[i]);
  EXPECT_TRUE(palette_of({}, 3, 8).labels.empty());
}

}  // namespace
}  // namespace l4d::io
