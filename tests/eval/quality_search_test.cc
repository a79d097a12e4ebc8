// SPDX-License-Identifier: Apache-2.0
#include "eval/target/quality_search.h"

#include <gtest/gtest.h>

#include <cmath>

namespace l4d::eval {
namespace {

using Obstacle = QualitySearch::Obstacle;

// Bytes that double every 8 dB.
double bytes_at(double quality) { return 1000 * std::exp2((quality - 20) / 8); }

Goal at_most_bytes(double bytes) {
  Goal goal;
  goal.requested = bytes;
  goal.at_most = goal.rises = goal.logarithm = true;
  goal.slope = 0.08;
  goal.tolerance = 0.02;
  return goal;
}

QualitySearch search(const Goal& goal, const std::function<double(double)>& figure_at) {
  size_t kept = 0;
  const QualitySearch found = search_quality(
      goal, {20, 90, 44}, [&](double quality, size_t) { return figure_at(quality); },
      [&] { ++kept; });
  EXPECT_GE(kept, 1u);
  return found;
}

TEST(QualitySearch, ComesAsNearAsTheToleranceFromTheSideThatKeepsTheBound) {
  for (const double requested : {1500.0, 20000.0, 300000.0}) {
    const QualitySearch found = search(at_most_bytes(requested), bytes_at);
    EXPECT_EQ(found.obstacle, Obstacle::kNone);
    EXPECT_TRUE(found.result().met);
    EXPECT_LE(found.result().figure, requested);
    EXPECT_GE(found.result().figure, requested * std::exp(-0.02));
    EXPECT_EQ(found.result().figure, bytes_at(found.result().quality));
  }
}

TEST(QualitySearch, SaysThatTheRangeEnds) {
  const QualitySearch low = search(at_most_bytes(10), bytes_at);
  EXPECT_EQ(low.obstacle, Obstacle::kEndOfRange);
  EXPECT_EQ(low.low, 20);
  EXPECT_FALSE(low.result().met);
  const QualitySearch high = search(at_most_bytes(1e9), bytes_at);
  EXPECT_EQ(high.obstacle, Obstacle::kEndOfRange);
  EXPECT_EQ(high.high, 90);
  EXPECT_TRUE(high.result().met);
}

TEST(QualitySearch, SaysBetweenWhichQualitiesTheFigureJumps) {
  const QualitySearch found =
      search(at_most_bytes(5000), [](double quality) { return quality < 51.3 ? 3000.0 : 9000.0; });
  EXPECT_EQ(found.obstacle, Obstacle::kNoQualityBetween);
  EXPECT_LT(found.low, 51.3);
  EXPECT_GE(found.high, 51.3);
  EXPECT_TRUE(found.result().met);
  EXPECT_EQ(found.result().figure, 3000);
}

}  // namespace
}  // namespace l4d::eval
