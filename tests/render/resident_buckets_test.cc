// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/player/resident_buckets.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "tests/common/random.h"

namespace l4d::render {
namespace {

TEST(ResidentBuckets, GivesChunksOnce) {
  ResidentBuckets cache(100);
  cache.grow(5);
  const ResidentBucket* a = cache.add({0, 0}, 201);
  ASSERT_NE(a, nullptr);
  EXPECT_EQ(a->chunks, (std::vector<uint32_t>{0, 1, 2}));
  EXPECT_EQ(a->slots, 201u);
  EXPECT_FALSE(a->filled);
  EXPECT_EQ(cache.add({0, 1}, 201), nullptr);  // wanted now: nothing to give up
  EXPECT_NE(cache.add({0, 1}, 200), nullptr);
  EXPECT_EQ(cache.used(), 5u);
  EXPECT_EQ(cache.slots(), 401u);
  cache.grow(6);
  EXPECT_EQ(cache.add({1, 0}, 1)->chunks, std::vector<uint32_t>{5});
  cache.remove({0, 0});
  EXPECT_EQ(cache.used(), 3u);
  EXPECT_EQ(cache.find({0, 0}), nullptr);
  EXPECT_EQ(cache.add({1, 1}, 150)->chunks, (std::vector<uint32_t>{0, 1}));
}

TEST(ResidentBuckets, GivesUpWhatWasNotWantedForLongest) {
  ResidentBuckets cache(10);
  cache.grow(4);
  for (uint32_t b = 0; b < 4; ++b) {
    cache.next_turn();
    ASSERT_NE(cache.add({0, b}, 10), nullptr);
  }
  cache.next_turn();
  EXPECT_EQ(cache.idle(), 4u);
  EXPECT_NE(cache.want({0, 0}), nullptr);  // the oldest is wanted again
  EXPECT_EQ(cache.want({9, 9}), nullptr);
  EXPECT_EQ(cache.idle(), 3u);
  ASSERT_NE(cache.add({1, 0}, 15), nullptr);
  EXPECT_NE(cache.find({0, 0}), nullptr);
  EXPECT_EQ(cache.find({0, 1}), nullptr);
  EXPECT_EQ(cache.find({0, 2}), nullptr);
  EXPECT_NE(cache.find({0, 3}), nullptr);
  EXPECT_EQ(cache.add({1, 1}, 11), nullptr);  // what does not fit costs nothing
  EXPECT_NE(cache.find({0, 3}), nullptr);
}

// Whatever is asked: chunks belong to one bucket at most, wanted buckets stay, the counts are
// right.
TEST(ResidentBuckets, HoldsInvariantsUnderRandomUse) {
  test::Random random(12);
  ResidentBuckets cache(64);
  cache.grow(40);
  std::map<BucketKey, uint32_t> wanted;  // in this turn
  for (int step = 0; step < 20000; ++step) {
    const BucketKey key{random.below(3), random.below(30)};
    const ResidentBucket* there = nullptr;
    switch (random.below(10)) {
      case 0:
        cache.next_turn();
        wanted.clear();
        break;
      case 1:
        cache.remove(key);
        wanted.erase(key);
        break;
      default:
        there = cache.want(key);
        if (there == nullptr) {
          const uint32_t slots = 1 + random.below(400);
          const uint32_t free = cache.capacity() - cache.used() + cache.idle();
          there = cache.add(key, slots);
          ASSERT_EQ(there != nullptr, cache.chunks_of(slots) <= free);
        }
        if (there != nullptr) wanted[key] = there->slots;
    }
    std::set<uint32_t> chunks;
    uint64_t slots = 0;
    uint32_t used = 0;
    for (uint32_t layer = 0; layer < 3; ++layer) {
      for (uint32_t bucket = 0; bucket < 30; ++bucket) {
        const ResidentBucket* b = cache.find({layer, bucket});
        if (b == nullptr) continue;
        slots += b->slots;
        used += static_cast<uint32_t>(b->chunks.size());
        for (const uint32_t c : b->chunks) {
          ASSERT_LT(c, cache.capacity());
          ASSERT_TRUE(chunks.insert(c).second);
        }
      }
    }
    ASSERT_EQ(slots, cache.slots());
    ASSERT_EQ(used, cache.used());
    for (const auto& [k, n] : wanted) {
      ASSERT_NE(cache.find(k), nullptr);
      ASSERT_EQ(cache.find(k)->slots, n);
    }
  }
}

}  // namespace
}  // namespace l4d::render
