// SPDX-License-Identifier: Apache-2.0
// The reference loops decode what the encoder wrote, and every SIMD target that is compiled in and
// that this machine has leaves the same behind, whatever the words are.
#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <hwy/targets.h>

#include "tests/entropy/rans_channels.h"

namespace l4d {
namespace {

using test::decode;
using test::expected;
using test::kShapes;
using test::Random;
using test::random_channel;
using test::RansCase;
using test::RansResult;
using test::Shape;

constexpr size_t kLengths[] = {0, 1, 2, 31, 32, 33, 63, 64, 65, 100, 1000, 4096, 65537};

std::vector<int64_t> compiled_targets() {
  std::vector<int64_t> targets;
  for (int64_t rest = HWY_TARGETS; rest != 0; rest &= rest - 1) targets.push_back(rest & -rest);
  return targets;
}

class RansKernelTest : public testing::TestWithParam<int64_t> {
 protected:
  void SetUp() override {
    if ((hwy::SupportedTargets() & GetParam()) == 0) {
      GTEST_SKIP() << hwy::TargetName(GetParam()) << " is not available on this machine";
    }
    hwy::SetSupportedTargetsForTest(GetParam());
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  void TearDown() override {
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  // Both decode the block to what was coded.
  static void check(const RansCase& c) {
    const Bytes block = c.block();
    const RansResult want = expected(c, block.size());
    ASSERT_TRUE(decode(rans_kernels_reference(), c, block) == want);
    ASSERT_TRUE(decode(rans_kernels_simd(), c, block) == want);
  }
};

RansCase one_of_each(size_t n, Shape shape, size_t contexts, uint64_t seed) {
  RansCase c;
  c.hybrid.push_back(random_channel<uint16_t>(n, shape, contexts, seed));
  c.wide.push_back(random_channel<uint64_t>(n, shape, contexts, seed + 1));
  return c;
}

TEST_P(RansKernelTest, EveryShapeAndLength) {
  for (const Shape shape : kShapes) {
    for (const size_t n : kLengths) {
      for (const size_t contexts : {size_t{0}, size_t{1}, size_t{5}}) {
        if (n == 65537 && contexts == 1) continue;
        SCOPED_TRACE(testing::Message() << "shape " << static_cast<int>(shape) << ", n " << n
                                        << ", contexts " << contexts);
        check(one_of_each(n, shape, contexts, n));
        if (HasFatalFailure()) return;
      }
    }
  }
}

TEST_P(RansKernelTest, ManyChannelsUnderOneSetOfLanes) {
  for (uint64_t seed = 0; seed < 60; ++seed) {
    Random random(seed);
    RansCase c;
    for (uint32_t i = random.below(8) + 1; i > 0; --i) {
      c.hybrid.push_back(random_channel<uint16_t>(random.below(300), kShapes[random.below(5)],
                                                  random.below(4), random.bits()));
    }
    for (uint32_t i = random.below(8) + 1; i > 0; --i) {
      c.wide.push_back(random_channel<uint64_t>(random.below(300), kShapes[random.below(5)],
                                                random.below(4), random.bits()));
    }
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    check(c);
    if (HasFatalFailure()) return;
  }
}

TEST_P(RansKernelTest, AllContexts) {
  RansCase c;
  c.hybrid.push_back(random_channel<uint16_t>(5000, Shape::kSmall, 256, 7));
  check(c);
}

// Of a block that ends early, all that was there is used, nothing past its end is read, and the
// lanes say so.
TEST_P(RansKernelTest, TruncatedAtEveryLength) {
  for (const Shape shape : {Shape::kUniform, Shape::kGeometric}) {
    const RansCase c = one_of_each(150, shape, 0, 3);
    const Bytes block = c.block();
    for (size_t size = kRansStateBytes; size < block.size(); ++size) {
      // An exact copy, so that a sanitizer sees every byte read beyond the end.
      const Bytes shorter(block.begin(), block.begin() + static_cast<std::ptrdiff_t>(size));
      const RansResult want = decode(rans_kernels_reference(), c, shorter);
      ASSERT_TRUE(want.failed) << size;
      ASSERT_FALSE(want.finished) << size;
      ASSERT_EQ(want.position, size / 2 * 2);
      ASSERT_TRUE(decode(rans_kernels_simd(), c, shorter) == want) << size;
    }
  }
}

TEST_P(RansKernelTest, WordsLeftOverAreNoticed) {
  const RansCase c = one_of_each(150, Shape::kGeometric, 0, 4);
  Bytes block = c.block();
  const RansResult want = expected(c, block.size());
  for (size_t extra = 1; extra < 700; extra += 1 + extra / 8) {
    Bytes longer = block;
    longer.resize(block.size() + extra, 0x77);
    for (const RansKernels* kernels : {&rans_kernels_reference(), &rans_kernels_simd()}) {
      const RansResult got = decode(*kernels, c, longer);
      ASSERT_EQ(got.position, want.position);
      ASSERT_EQ(got.hybrid, want.hybrid);
      ASSERT_EQ(got.wide, want.wide);
      ASSERT_FALSE(got.failed);
      ASSERT_FALSE(got.finished);
    }
  }
}

// Flips one bit at a time and says in which part of all rounds that was found at the end.
double damage_found(const RansCase& c) {
  const Bytes block = c.block();
  const RansResult good = expected(c, block.size());
  Random random(11);
  int found = 0;
  constexpr int kRounds = 400;
  for (int round = 0; round < kRounds; ++round) {
    Bytes bad = block;
    const size_t at = random.below(static_cast<uint32_t>(bad.size()));
    bad[at] = static_cast<unsigned char>(bad[at] ^ (1u << random.below(8)));
    const RansResult want = decode(rans_kernels_reference(), c, bad);
    EXPECT_FALSE(want == good) << "byte " << at;
    EXPECT_TRUE(decode(rans_kernels_simd(), c, bad) == want) << "byte " << at;
    found += want.finished ? 0 : 1;
  }
  return static_cast<double>(found) / kRounds;
}

// Among tokens damage spreads, and the lanes do not end where they should. A bit that leaves the
// state as a raw bit changes its value alone.
TEST_P(RansKernelTest, DamageChangesAllAlike) {
  EXPECT_GT(damage_found(one_of_each(3000, Shape::kSmall, 0, 5)), 0.95);
  EXPECT_GT(damage_found(one_of_each(700, Shape::kGeometric, 3, 5)), 0.1);
}

TEST_P(RansKernelTest, RandomWords) {
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const RansCase c = one_of_each(500, kShapes[seed % 5], seed % 4, seed);
    Random random(seed);
    Bytes block(kRansStateBytes + random.below(3000));
    for (unsigned char& b : block) b = static_cast<unsigned char>(random.bits());
    for (size_t lane = 0; lane < kRansLanes; ++lane) block[4 * lane + 2] |= 1;  // states in range
    const RansResult want = decode(rans_kernels_reference(), c, block);
    ASSERT_EQ(want.states.size(), kRansLanes);
    ASSERT_TRUE(decode(rans_kernels_simd(), c, block) == want) << "seed " << seed;
  }
}

// Two pages with the tables of one channel, of other lengths, one or both cut short.
TEST_P(RansKernelTest, TwoPagesAtOnceAreAsEachAlone) {
  if (rans_kernels_simd().hybrid_pair == nullptr) GTEST_SKIP() << "pages go alone here";
  for (uint64_t seed = 0; seed < 400; ++seed) {
    Random random(seed);
    RansCase both;
    both.hybrid.push_back(random_channel<uint16_t>(random.below(600), kShapes[seed % 5],
                                                   seed / 5 % 4, random.bits()));
    RansCase cases[2] = {both, both};
    Bytes blocks[2];
    RansLanes lanes[2];
    std::vector<uint16_t> values[2];
    RansHybridTask tasks[2];
    for (size_t p = 0; p < 2; ++p) {
      auto& channel = cases[p].hybrid[0];
      const uint32_t most = static_cast<uint32_t>(channel.values.size());
      channel.values.resize(random.below(6) == 0 ? 0 : random.below(most + 1));
      blocks[p] = cases[p].block();
      if (random.below(3) == 0) {
        const size_t words = blocks[p].size() - kRansStateBytes + 1;
        blocks[p].resize(kRansStateBytes + random.below(static_cast<uint32_t>(words)));
        blocks[p].shrink_to_fit();
      }
    }
    for (size_t p = 0; p < 2; ++p) {
      const auto& channel = cases[p].hybrid[0];
      ASSERT_TRUE(open_rans_block(blocks[p], 0, &lanes[p]).ok());
      values[p].assign(channel.values.size() + 40, 0xa5a5);
      const size_t count = channel.values.size();
      const uint8_t* contexts = count == 0 ? nullptr : channel.context_pointer();
      tasks[p] = {&lanes[p], contexts, count, values[p].data()};
    }
    rans_kernels_simd().hybrid_pair(both.hybrid[0].entries.data(), tasks[0], tasks[1]);
    for (size_t p = 0; p < 2; ++p) {
      const RansResult want = decode(rans_kernels_reference(), cases[p], blocks[p]);
      ASSERT_EQ(values[p], want.hybrid[0]) << "seed " << seed << ", page " << p;
      ASSERT_TRUE(std::equal(want.states.begin(), want.states.end(), lanes[p].x)) << seed;
      ASSERT_EQ(lanes[p].next - blocks[p].data(), static_cast<std::ptrdiff_t>(want.position));
      ASSERT_EQ(lanes[p].failed, want.failed) << "seed " << seed << ", page " << p;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Targets, RansKernelTest, testing::ValuesIn(compiled_targets()),
                         [](const testing::TestParamInfo<int64_t>& target) {
                           return std::string(hwy::TargetName(target.param));
                         });

}  // namespace
}  // namespace l4d
