// SPDX-License-Identifier: Apache-2.0
// The pool of received bytes: against a plain array, and what its limits cost.
#include "decoder/playback/blocks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <vector>

#include "tests/common/random.h"

namespace l4d::playback {
namespace {

using test::Random;

Bytes file_of(size_t n) {
  Random random(7);
  Bytes bytes(n);
  for (unsigned char& b : bytes) b = static_cast<unsigned char>(random.bits());
  return bytes;
}

// A model: of each block of a file, how long its valid prefix is.
struct Model {
  std::map<uint64_t, uint64_t> fill;
  uint64_t append(uint64_t offset, uint64_t n) {
    for (uint64_t i = 0; i < n; ++i) {
      const uint64_t block = (offset + i) / Blocks::kBlockBytes;
      const uint64_t at = (offset + i) % Blocks::kBlockBytes;
      if (at > 0 && fill.count(block) == 0) return i;
      if (at > fill[block]) return i;
      fill[block] = std::max(fill[block], at + 1);
    }
    return n;
  }
  uint64_t gap_begin(uint64_t offset, uint64_t end) const {
    for (; offset < end; ++offset) {
      const auto it = fill.find(offset / Blocks::kBlockBytes);
      if (it == fill.end() || it->second <= offset % Blocks::kBlockBytes) break;
    }
    return offset;
  }
};

TEST(Blocks, HoldsWhatAPlainModelHolds) {
  const Bytes file = file_of(100000);
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    Random random(seed);
    Blocks blocks(uint64_t{4} << 20);
    Model model;
    for (int step = 0; step < 300; ++step) {
      uint64_t offset = random.below(100000);
      if (random.below(2) == 0) offset = offset / Blocks::kBlockBytes * Blocks::kBlockBytes;
      if (random.below(2) == 0) offset = model.gap_begin(offset, 99999);
      const uint64_t n = std::min<uint64_t>(1 + random.below(9000), 100000 - offset);
      const ByteSpan data(file.data() + offset, static_cast<size_t>(n));
      ASSERT_EQ(blocks.append(offset, data), model.append(offset, n));
      const uint64_t from = random.below(99000);
      const uint64_t end = from + random.below(static_cast<uint32_t>(100000 - from));
      const uint64_t gap = blocks.gap_begin(from, end);
      ASSERT_EQ(gap, std::min(model.gap_begin(from, end), end));
      Bytes got(static_cast<size_t>(gap - from));
      blocks.read(from, got.size(), got.data());
      ASSERT_TRUE(std::equal(got.begin(), got.end(), file.begin() + static_cast<ptrdiff_t>(from)));
    }
  }
}

TEST(Blocks, EvictsWhatWasUsedLongestAgoAndNothingOfTheEpoch) {
  Blocks blocks(Blocks::kSlabBytes);
  const Bytes block(Blocks::kBlockBytes, 1);
  const uint64_t n = Blocks::kSlabBytes / Blocks::kBlockBytes;
  for (uint64_t i = 0; i < n; ++i) {
    ASSERT_EQ(blocks.append(i * Blocks::kBlockBytes, ByteSpan(block.data(), block.size())),
              Blocks::kBlockBytes);
  }
  EXPECT_TRUE(blocks.is_full());
  // All of one epoch: nothing goes, nothing comes.
  EXPECT_EQ(blocks.append(n * Blocks::kBlockBytes, ByteSpan(block.data(), block.size())), 0u);
  blocks.begin_epoch();
  blocks.use(0, 10 * Blocks::kBlockBytes);
  for (uint64_t i = n; i < n + 5; ++i) {
    ASSERT_EQ(blocks.append(i * Blocks::kBlockBytes, ByteSpan(block.data(), block.size())),
              Blocks::kBlockBytes);
  }
  EXPECT_EQ(blocks.num_evicted(), 5u);
  EXPECT_EQ(blocks.gap_begin(0, 20 * Blocks::kBlockBytes), 10 * Blocks::kBlockBytes);
  EXPECT_EQ(blocks.gap_end(10 * Blocks::kBlockBytes, 20 * Blocks::kBlockBytes),
            15 * Blocks::kBlockBytes);
  EXPECT_EQ(blocks.gap_begin(15 * Blocks::kBlockBytes, (n + 5) * Blocks::kBlockBytes),
            (n + 5) * Blocks::kBlockBytes);
  EXPECT_LE(blocks.memory_bytes(), Blocks::kSlabBytes + Blocks::kSlabBytes / 16);
}

// Each piece of a byte costs the same, however many are held: a search of all would take minutes.
TEST(Blocks, AMillionPiecesAtTheLimit) {
  Blocks blocks(Blocks::kSlabBytes);
  const unsigned char byte = 5;
  for (uint64_t i = 0; i < 1000000; ++i) {
    if (i % 100 == 0) blocks.begin_epoch();
    ASSERT_EQ(blocks.append(i * Blocks::kBlockBytes, ByteSpan(&byte, 1)), 1u);
  }
  EXPECT_EQ(blocks.num_blocks(), Blocks::kSlabBytes / Blocks::kBlockBytes);
  EXPECT_EQ(blocks.num_evicted(), 1000000 - blocks.num_blocks());
}

TEST(Blocks, OverwritesWhatIsHeldAlone) {
  Blocks blocks(Blocks::kSlabBytes);
  const Bytes old(6000, 1), fresh(3000, 2);
  blocks.append(0, ByteSpan(old.data(), old.size()));
  blocks.overwrite(4000, ByteSpan(fresh.data(), fresh.size()));
  EXPECT_EQ(blocks.gap_begin(0, 10000), 6000u);
  Bytes got(6000);
  blocks.read(0, 6000, got.data());
  EXPECT_EQ(std::count(got.begin(), got.end(), 1), 4000);
  EXPECT_EQ(std::count(got.begin() + 4000, got.end(), 2), 2000);
}

}  // namespace
}  // namespace l4d::playback
