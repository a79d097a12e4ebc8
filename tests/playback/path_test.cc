// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/path.h"

#include <gtest/gtest.h>

#include <vector>

namespace l4d::playback {
namespace {

std::vector<Segment> path_of(uint32_t mode, double time, int direction, double length) {
  Path path;
  path.set_range(2, 5, mode);
  std::vector<Segment> out;
  path.segments({time, direction}, length, &out);
  return out;
}

void expect_segment(const Segment& s, double from, double to, double at) {
  EXPECT_DOUBLE_EQ(s.from, from);
  EXPECT_DOUBLE_EQ(s.to, to);
  EXPECT_DOUBLE_EQ(s.at, at);
}

TEST(Path, EndsAtTheBorder) {
  std::vector<Segment> s = path_of(L4D_PLAY_ONCE, 4, 1, 6);
  ASSERT_EQ(s.size(), 1u);
  expect_segment(s[0], 4, 5, 0);
  s = path_of(L4D_PLAY_ONCE, 4, -1, 1.5);
  ASSERT_EQ(s.size(), 1u);
  expect_segment(s[0], 4, 2.5, 0);
  s = path_of(L4D_PLAY_ONCE, 5, 1, 6);
  ASSERT_EQ(s.size(), 1u);
  expect_segment(s[0], 5, 5, 0);
}

TEST(Path, ALoopHoldsItsBegin) {
  std::vector<Segment> s = path_of(L4D_PLAY_LOOP, 4, 1, 2.5);
  ASSERT_EQ(s.size(), 2u);
  expect_segment(s[0], 4, 5, 0);
  expect_segment(s[1], 2, 3.5, 1);
  s = path_of(L4D_PLAY_LOOP, 3, -1, 100);
  ASSERT_EQ(s.size(), 2u) << "once around";
  expect_segment(s[0], 3, 2, 0);
  expect_segment(s[1], 5, 3, 1);
}

TEST(Path, PingPongTurns) {
  const std::vector<Segment> s = path_of(L4D_PLAY_PING_PONG, 4, 1, 5);
  ASSERT_EQ(s.size(), 3u);
  expect_segment(s[0], 4, 5, 0);
  expect_segment(s[1], 5, 2, 1);
  expect_segment(s[2], 2, 3, 4);
}

TEST(Path, OfAnInstantEnds) {
  Path path;
  path.set_range(3, 3, L4D_PLAY_LOOP);
  std::vector<Segment> out;
  path.segments({3, 1}, 6, &out);
  ASSERT_EQ(out.size(), 1u);
  expect_segment(out[0], 3, 3, 0);
  Position p{3, 1};
  EXPECT_FALSE(path.turn(&p));
}

}  // namespace
}  // namespace l4d::playback
