// SPDX-License-Identifier: Apache-2.0
// Deadlines and delays of requests, and the buckets of a caller.
#include "decoder/playback/link.h"

#include <gtest/gtest.h>

#include <cmath>

#include "decoder/playback/residents.h"

namespace l4d::playback {
namespace {

WantedRange range_of(uint64_t begin, uint64_t end) {
  WantedRange range;
  range.begin = begin;
  range.end = end;
  return range;
}

TEST(Link, DelaysDoubleUpToTheLast) {
  Link link{LinkOptions()};
  double now = 0, expected = 0.25;
  for (uint32_t i = 1; i <= 4; ++i) {
    const uint32_t id = link.start(range_of(0, 4096), false, false, now, 0).id;
    EXPECT_EQ(id, i);
    link.remove(id);
    bool went_down = false;
    const double delay = link.add_failure(id, now, 0, &went_down);
    EXPECT_FALSE(went_down);
    EXPECT_GE(delay, 0.75 * expected);
    EXPECT_LE(delay, 1.25 * expected);
    EXPECT_EQ(link.hold_until(), now + delay);
    now += delay;
    expected *= 2;
  }
  bool went_down = false;
  link.add_failure(5, now, 0, &went_down);
  EXPECT_TRUE(went_down);
  EXPECT_GE(link.hold_until(), now + 6);
  link.start(range_of(0, 4096), false, false, now, 0);
  EXPECT_FALSE(link.has_slot()) << "one probe";
  EXPECT_TRUE(link.add_success(7));
  EXPECT_TRUE(link.has_slot());
  EXPECT_FALSE(link.add_success(8)) << "it was up";
  EXPECT_EQ(link.succeeded_at(), 8);
  // What the server states holds, and failures before the next attempt are one.
  const double before = link.hold_until();
  link.add_failure(6, before + 1, 30, &went_down);
  EXPECT_EQ(link.hold_until(), before + 31);
  for (uint32_t i = 7; i < 20; ++i) link.add_failure(i, before + i, 0, &went_down);
  EXPECT_FALSE(link.is_down());
}

TEST(Link, AnAnswerMayWaitForThoseBefore) {
  Link link{LinkOptions()};
  const Request& first = link.start(range_of(0, 100000), false, true, 0, 0);
  EXPECT_EQ(link.deadline_of(first), 3);
  link.find(1)->urgent = false;
  EXPECT_EQ(link.deadline_of(*link.find(1)), 10);
  // 100 kB at 10 kB/s are under way, for which twice the time is allowed.
  const Request& second = link.start(range_of(100000, 200000), false, true, 1, 10000);
  EXPECT_DOUBLE_EQ(link.deadline_of(second), 1 + 20 + 3);
  // Without a measurement, the link has to be silent.
  link.set_alive(8);
  EXPECT_EQ(link.deadline_of(*link.find(1)), 18);
  // An answer that has begun has to go on.
  Request* const begun = link.find(1);
  begun->received = 10;
  begun->first_byte = begun->last_byte = 9;
  EXPECT_EQ(link.deadline_of(*begun), 14);
  EXPECT_EQ(link.next_deadline(), 14);
  begun->at = 60000;
  EXPECT_EQ(link.bytes_under_way(), 140000u);
}

TEST(Residents, UnloadsWhatWasNeededLongestAgo) {
  Residents r;
  r.set_limits(1000, 100);
  for (uint32_t b = 0; b < 3; ++b) {
    r.begin_load({0, 0, b}, 7, b + 1, 0, 201);  // 300 each
    EXPECT_EQ(r.units(), 300u * (b + 1));
  }
  EXPECT_EQ(r.num_loading(), 3u);
  EXPECT_FALSE(r.fits(101));
  EXPECT_TRUE(r.fits(100));
  r.begin_epoch();
  EXPECT_EQ(r.victim(), nullptr) << "they are being loaded";
  ASSERT_NE(r.end_load(2, true, 150), nullptr);
  EXPECT_EQ(r.units(), 800u) << "it took less";
  EXPECT_EQ(r.end_load(2, true, 150), nullptr) << "once";
  r.end_load(1, true, 201);
  r.end_load(3, false, 0);
  r.remove({0, 0, 2});
  EXPECT_EQ(r.num_loading(), 0u);
  EXPECT_EQ(r.units(), 500u);
  r.use({0, 0, 0});
  ASSERT_NE(r.victim(), nullptr);
  EXPECT_EQ(r.victim()->name.bucket, 1u);
  r.use({0, 0, 1});
  EXPECT_EQ(r.victim(), nullptr) << "both are needed";
  r.begin_epoch();
  EXPECT_EQ(r.victim()->name.bucket, 0u);
  for (uint32_t b = 10; b < 2000; ++b) {
    r.begin_load({1, 1, b}, 9, b, 0, 1);
    ASSERT_NE(r.end_load(b, true, 1), nullptr);
    r.remove({1, 1, b});
  }
  EXPECT_EQ(r.units(), 500u);
  EXPECT_EQ(r.find({1, 1, 1999}), nullptr);
  EXPECT_NE(r.find({0, 0, 1}), nullptr);
  EXPECT_EQ(r.find({2, 0, 1}), nullptr) << "of another part";
  EXPECT_EQ(r.find_any(1), nullptr);
  ASSERT_NE(r.find_any(0), nullptr);
  EXPECT_EQ(r.find_any(0)->stream, 7u);
}

}  // namespace
}  // namespace l4d::playback
