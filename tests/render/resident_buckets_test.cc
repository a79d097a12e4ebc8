// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/player/resident_buckets.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/common/random.h"

namespace l4d::render {
namespace {

TEST(ResidentBuckets, GivesChunksOnce) {
  ResidentBuckets cache(100);
  cache.grow(5);
  const ResidentBucket* a = cache.add({0, 0, 0}, 201);
  ASSERT_NE(a, nullptr);
  EXPECT_EQ(a->chunks, (std::vector<uint32_t>{0, 1, 2}));
  EXPECT_EQ(a->slots, 201u);
  EXPECT_FALSE(a->filled);
  EXPECT_EQ(cache.add({0, 0, 1}, 201), nullptr);  // nothing is given up
  EXPECT_NE(cache.add({0, 0, 1}, 200), nullptr);
  EXPECT_EQ(cache.used(), 5u);
  EXPECT_EQ(cache.slots(), 401u);
  cache.grow(6);
  EXPECT_EQ(cache.add({0, 1, 0}, 1)->chunks, std::vector<uint32_t>{5});
  cache.remove({0, 0, 0});
  EXPECT_EQ(cache.used(), 3u);
  EXPECT_EQ(cache.find({0, 0, 0}), nullptr);
  EXPECT_EQ(cache.find({1, 1, 0}), nullptr) << "of another stream";
  EXPECT_EQ(cache.add({1, 1, 0}, 150)->chunks, (std::vector<uint32_t>{0, 1}));
  cache.clear();
  EXPECT_EQ(cache.used(), 0u);
  EXPECT_EQ(cache.slots(), 0u);
}

// Whatever is asked: chunks belong to one bucket at most, and the counts are right.
TEST(ResidentBuckets, HoldsInvariantsUnderRandomUse) {
  test::Random random(12);
  ResidentBuckets cache(64);
  cache.grow(40);
  for (int step = 0; step < 20000; ++step) {
    const BucketKey key{random.below(2), random.below(3), random.below(15)};
    if (random.below(3) == 0) {
      cache.remove(key);
    } else if (cache.find(key) == nullptr) {
      const uint32_t slots = 1 + random.below(400);
      const uint32_t free = cache.capacity() - cache.used();
      const ResidentBucket* const there = cache.add(key, slots);
      ASSERT_EQ(there != nullptr, cache.chunks_of(slots) <= free);
    }
    std::set<uint32_t> chunks;
    uint64_t slots = 0;
    uint32_t used = 0;
    for (const auto& [k, bucket] : cache.all()) {
      slots += bucket.slots;
      used += static_cast<uint32_t>(bucket.chunks.size());
      ASSERT_EQ(bucket.chunks.size(), cache.chunks_of(bucket.slots));
      for (const uint32_t c : bucket.chunks) {
        ASSERT_LT(c, cache.capacity());
        ASSERT_TRUE(chunks.insert(c).second);
      }
    }
    ASSERT_EQ(slots, cache.slots());
    ASSERT_EQ(used, cache.used());
  }
}

}  // namespace
}  // namespace l4d::render
