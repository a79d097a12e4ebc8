// SPDX-License-Identifier: Apache-2.0
// Chunks that arrive wrong: no state of one is final, and each has a time at which it is tried.
#include "decoder/playback/ledger.h"

#include <gtest/gtest.h>

#include <cmath>

namespace l4d::playback {
namespace {

TEST(Ledger, TheSameWrongBytesTwiceAreDamage) {
  Ledger ledger;
  EXPECT_EQ(ledger.find(100), nullptr);
  EXPECT_FALSE(ledger.add_wrong(100, 50, 1, 10));
  ASSERT_NE(ledger.find(100), nullptr);
  EXPECT_FALSE(ledger.find(100)->lost);
  EXPECT_EQ(ledger.find(100)->at, 10);
  EXPECT_TRUE(ledger.add_wrong(100, 50, 1, 11));
  EXPECT_EQ(ledger.find(100)->cause, static_cast<uint32_t>(L4D_CAUSE_DAMAGED));
  EXPECT_EQ(ledger.next_time(11), 71);
  EXPECT_FALSE(ledger.expire(70));
  EXPECT_TRUE(ledger.expire(71));
  // Once more, then by retry alone.
  EXPECT_TRUE(ledger.add_wrong(100, 50, 1, 72));
  EXPECT_EQ(ledger.next_time(72), HUGE_VAL);
  ledger.retry(80);
  EXPECT_FALSE(ledger.find(100)->lost);
  EXPECT_TRUE(ledger.set_right(100));
  EXPECT_EQ(ledger.find(100), nullptr);
}

TEST(Ledger, OtherWrongBytesAreGarbledAfterFourAnswers) {
  Ledger ledger;
  EXPECT_FALSE(ledger.add_wrong(0, 50, 1, 0));
  EXPECT_FALSE(ledger.add_wrong(0, 50, 2, 0));
  EXPECT_EQ(ledger.find(0)->at, 1);
  EXPECT_FALSE(ledger.add_wrong(0, 50, 3, 1));
  EXPECT_EQ(ledger.find(0)->at, 5);
  EXPECT_TRUE(ledger.add_wrong(0, 50, 4, 5));
  EXPECT_EQ(ledger.find(0)->cause, static_cast<uint32_t>(L4D_CAUSE_GARBLED));
  EXPECT_EQ(ledger.find(0)->at, 15);
  // Each loss doubles the delay, up to five minutes.
  double now = 15, delay = 20;
  for (int i = 0; i < 8; ++i) {
    ASSERT_TRUE(ledger.expire(now));
    ASSERT_TRUE(ledger.add_wrong(0, 50, 100 + static_cast<uint64_t>(i), now));
    EXPECT_EQ(ledger.find(0)->at, now + delay);
    now += delay;
    delay = std::min(2 * delay, 300.0);
  }
}

TEST(Ledger, KeepsTheNewestAndIsBounded) {
  Ledger ledger;
  for (uint64_t i = 0; i < 5000; ++i) ledger.lose(7919 * i % 5000, 1, L4D_CAUSE_TRUNCATED, 0);
  EXPECT_EQ(ledger.entries().size(), 4096u);
  EXPECT_EQ(ledger.find(0), nullptr);
  EXPECT_NE(ledger.find(7919 * 4999 % 5000), nullptr);
  for (size_t i = 1; i < ledger.entries().size(); ++i) {
    ASSERT_LT(ledger.entries()[i - 1].offset, ledger.entries()[i].offset);
  }
  EXPECT_FALSE(ledger.lose(7919 * 4999 % 5000, 1, L4D_CAUSE_TRUNCATED, 0)) << "no news";
}

}  // namespace
}  // namespace l4d::playback
