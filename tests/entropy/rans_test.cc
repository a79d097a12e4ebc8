// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/entropy/rans.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/entropy/rans_channels.h"

namespace l4d {
namespace {

using test::channel_of;
using test::decode;
using test::Random;
using test::RansCase;

// The definition of hybrid integers, bit by bit.
TEST(RansToken, Hybrid) {
  for (uint32_t value = 0; value < 65536; ++value) {
    const RansToken t = hybrid_token(static_cast<uint16_t>(value));
    if (value < 16) {
      ASSERT_EQ(t.token, value);
      ASSERT_EQ(t.bits, 0u);
      continue;
    }
    uint32_t n = 0;
    while ((value >> (n + 1)) != 0) ++n;
    ASSERT_EQ(t.token, 16 + ((n - 4) << 3) + ((value >> (n - 3)) & 7));
    ASSERT_EQ(t.bits, n - 3);
    ASSERT_EQ(t.raw, value % (1u << (n - 3)));
  }
  EXPECT_EQ(hybrid_token(65535).token, kRansHybridTokens - 1);
}

TEST(RansToken, Wide) {
  EXPECT_EQ(wide_token(0).token, 0u);
  EXPECT_EQ(wide_token(1).token, 1u);
  EXPECT_EQ(wide_token(1).bits, 0u);
  Random random(1);
  for (uint32_t n = 1; n <= 62; ++n) {
    const uint64_t first = uint64_t{1} << n;
    for (const uint64_t value : {first, first + first / 2 - 1, first + first / 2, 2 * first - 1,
                                 first | (random.bits() % first)}) {
      const RansToken t = wide_token(value);
      ASSERT_EQ(t.token, 2 * n + (value >= first + first / 2 ? 1 : 0)) << value;
      ASSERT_EQ(t.bits, n - 1);
      ASSERT_EQ(t.raw, value % (uint64_t{1} << (n - 1)));
    }
  }
  EXPECT_EQ(wide_token(~uint64_t{0} >> 1).token, kRansWideTokens - 1);
}

Bytes table_bytes(const std::vector<uint64_t>& numbers) {
  Bytes out;
  for (const uint64_t number : numbers) append_vlq(number, out);
  return out;
}

std::string clause_of(const Bytes& bytes, size_t max_tokens) {
  ByteReader in(bytes);
  std::vector<uint32_t> entries(kRansSlots);
  const Status status = read_rans_table(in, 1000, max_tokens, entries.data());
  if (status.ok()) return "";
  EXPECT_EQ(status.code(), L4D_ERR_CORRUPT);
  EXPECT_EQ(status.offset(), 1000u);
  return status.clause();
}

// spec: RANS-2
TEST(RansTable, OnlyWholeTablesAreRead) {
  EXPECT_EQ(clause_of(table_bytes({1, 1024}), 1), "");
  EXPECT_EQ(clause_of(table_bytes({3, 1, 2, 1021}), 3), "");
  EXPECT_EQ(clause_of(table_bytes({5, 0, 3, 1024}), 5), "");
  EXPECT_EQ(clause_of(table_bytes({256, 1023, 0, 253, 1}), 256), "");
  EXPECT_EQ(clause_of(table_bytes({0}), 9), "RANS-2");
  EXPECT_EQ(clause_of(table_bytes({4, 0, 2, 1024}), 3), "RANS-2");  // too many tokens
  EXPECT_EQ(clause_of(table_bytes({257, 0, 255, 1024}), 1000), "RANS-2");
  EXPECT_EQ(clause_of(table_bytes({~uint64_t{0} >> 1, 1024}), 256), "RANS-2");
  EXPECT_EQ(clause_of(table_bytes({2, 2048, 2047}), 9), "RANS-2");  // sums
  EXPECT_EQ(clause_of(table_bytes({2, 2048, 2049}), 9), "RANS-2");
  EXPECT_EQ(clause_of(table_bytes({1, 1025}), 9), "RANS-2");
  EXPECT_EQ(clause_of(table_bytes({2, 1, (uint64_t{1} << 32) + 1023}), 9), "RANS-2");
  EXPECT_EQ(clause_of(table_bytes({2, 1024, 0, 0}), 9), "RANS-2");  // zeros at the end
  EXPECT_EQ(clause_of(table_bytes({3, 1024, 0, 1}), 9), "RANS-2");
  EXPECT_EQ(clause_of(table_bytes({3, 0, 3, 1024}), 9), "RANS-2");
  EXPECT_EQ(clause_of(table_bytes({3, 0, ~uint64_t{0} >> 1, 1024}), 9), "RANS-2");
}

// spec: RANS-1
TEST(RansTable, TruncatedAtEveryLength) {
  const Bytes good = table_bytes({201, 300, 0, 150, 500, 0, 44, 1, 1, 222});
  ASSERT_EQ(clause_of(good, 201), "");
  for (size_t size = 0; size < good.size(); ++size) {
    const Bytes shorter(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_EQ(clause_of(shorter, 201), "RANS-1") << size;
  }
  EXPECT_EQ(clause_of(Bytes(20, 0xff), 200), "RANS-1");  // a number that never ends
}

TEST(RansTable, WrittenTablesAreReadBack) {
  Random random(2);
  for (int round = 0; round < 300; ++round) {
    std::vector<uint64_t> counts(1 + random.below(256), 0);
    const uint32_t used = 1 + random.below(8);
    for (uint64_t& count : counts) {
      if (random.below(8) < used) count = random.bits() >> (24 + random.below(40));
    }
    const RansTable table(counts);
    Bytes bytes;
    table.append_to(bytes);
    bytes.insert(bytes.end(), 3, 0xee);
    std::vector<uint32_t> want(kRansSlots), got(kRansSlots);
    table.expand(want.data());
    ByteReader in(bytes);
    ASSERT_TRUE(read_rans_table(in, 0, counts.size(), got.data()).ok());
    ASSERT_EQ(got, want);
    ASSERT_EQ(in.remaining(), 3u);
    uint32_t slot = 0;
    for (size_t token = 0; token < counts.size(); ++token) {
      ASSERT_TRUE(counts[token] == 0 || table.frequency(token) > 0);
      for (uint32_t bias = 0; bias < table.frequency(token); ++bias, ++slot) {
        ASSERT_EQ(want[slot], (table.frequency(token) - 1) << 20 | bias << 8 | token);
      }
    }
    ASSERT_EQ(slot, kRansSlots);
  }
}

TEST(RansTable, OfNothingOrOfOneToken) {
  const RansTable nothing{std::vector<uint64_t>(5, 0)};
  EXPECT_EQ(nothing.tokens(), 1u);
  EXPECT_EQ(nothing.frequency(0), kRansSlots);
  const RansTable one{std::vector<uint64_t>{0, 0, 9, 0}};
  EXPECT_EQ(one.tokens(), 3u);
  EXPECT_EQ(one.frequency(2), kRansSlots);
  EXPECT_EQ(one.frequency(1), 0u);
  EXPECT_EQ(one.frequency(3), 0u);
  const RansTable two{std::vector<uint64_t>{1, 3}};
  EXPECT_EQ(two.frequency(0), kRansSlots / 4);
  EXPECT_EQ(two.frequency(1), 3 * kRansSlots / 4);
}

// Against all tables of three tokens.
TEST(RansTable, CodesItsCountsInTheFewestBits) {
  std::vector<double> bits(kRansSlots + 1, 0);
  for (uint32_t f = 1; f <= kRansSlots; ++f) bits[f] = 12 - std::log2(static_cast<double>(f));
  for (const std::vector<uint64_t>& counts :
       {std::vector<uint64_t>{1, 1, 100000}, {3, 7, 20000}, {1, 5000, 5001}}) {
    const auto total_bits = [&](uint32_t a, uint32_t b, uint32_t c) {
      return static_cast<double>(counts[0]) * bits[a] + static_cast<double>(counts[1]) * bits[b] +
             static_cast<double>(counts[2]) * bits[c];
    };
    double best = 1e300;
    for (uint32_t a = 1; a <= kRansSlots - 2; ++a) {
      for (uint32_t b = 1; a + b <= kRansSlots - 1; ++b) {
        best = std::min(best, total_bits(a, b, kRansSlots - a - b));
      }
    }
    const RansTable table(counts);
    const double got = total_bits(table.frequency(0), table.frequency(1), table.frequency(2));
    EXPECT_NEAR(got, best, 1e-9 * best);
  }
}

// Many tokens that are rarer than a slot: no exchange of a slot between two tokens may help.
TEST(RansTable, RareTokensAreTakenFromWhereItCostsLeast) {
  Random random(3);
  std::vector<uint64_t> counts(256);
  for (size_t i = 0; i < counts.size(); ++i) counts[i] = i < 10 ? 10000 + random.below(90000) : 1;
  const RansTable table(counts);
  const auto bits = [&](size_t token, uint32_t f) {
    return static_cast<double>(counts[token]) * (12 - std::log2(static_cast<double>(f)));
  };
  for (size_t up = 0; up < counts.size(); ++up) {
    for (size_t down = 0; down < counts.size(); ++down) {
      const uint32_t f = table.frequency(up), g = table.frequency(down);
      if (up == down || g == 1) continue;
      ASSERT_LE(bits(up, f) + bits(down, g), bits(up, f + 1) + bits(down, g - 1) + 1e-6);
    }
  }
}

// Words and states worked out by hand from the specification.
TEST(RansBlock, BytesAreThoseOfTheSpecification) {
  RansCase none;
  Bytes start;
  for (size_t lane = 0; lane < kRansLanes; ++lane) append_le(kRansLow, start);
  EXPECT_EQ(none.block(), start);

  // Frequencies 512 and 512; one symbol, token 1: (65536 / 512) * 1024 + 0 + 512.
  const RansTable halves{std::vector<uint64_t>{1, 1}};
  const std::vector<uint16_t> one_symbol{1};
  RansBlockWriter writer;
  writer.add_hybrid(&halves, nullptr, one_symbol);
  Bytes block, want = start;
  writer.finish(block);
  store_le(uint32_t{131584}, want.data());
  EXPECT_EQ(block, want);

  // A sure token and 16 raw bits: each symbol pushes the one after it in its lane to the words.
  RansCase c;
  std::vector<uint64_t> values;
  for (uint64_t i = 0; i < 2 * kRansLanes; ++i) values.push_back(0x20000 + 0x101 * i);
  c.wide.push_back(channel_of(values));
  want.clear();
  for (size_t i = 0; i < 32; ++i) append_le(static_cast<uint32_t>(0x10000 + 0x101 * i), want);
  for (size_t i = 32; i < 64; ++i) append_le(static_cast<uint16_t>(0x101 * i), want);
  for (size_t i = 0; i < 32; ++i) append_le(uint16_t{0}, want);
  EXPECT_EQ(c.block(), want);
}

// spec: RANS-1, RANS-3
TEST(RansBlock, StatesMustBeThereAndInRange) {
  Bytes block = RansCase().block();
  RansLanes lanes;
  EXPECT_TRUE(open_rans_block(block, 50, &lanes).ok());
  EXPECT_TRUE(rans_block_finished(lanes));
  for (size_t size = 0; size < block.size(); ++size) {
    const Status status = open_rans_block(ByteSpan(block.data(), size), 50, &lanes);
    EXPECT_STREQ(status.clause(), "RANS-1");
    EXPECT_EQ(status.offset(), 50u);
  }
  for (size_t lane = 0; lane < kRansLanes; ++lane) {
    Bytes bad = block;
    store_le(kRansLow - 1, bad.data() + 4 * lane);
    const Status status = open_rans_block(bad, 50, &lanes);
    EXPECT_STREQ(status.clause(), "RANS-3");
    EXPECT_EQ(status.offset(), 50 + 4 * lane);
  }
}

// The encoder divides by each frequency through its reciprocal.
TEST(RansBlock, EveryFrequencyDividesExactly) {
  Random random(4);
  std::vector<uint16_t> values(512);
  std::vector<uint16_t> got(values.size());
  std::vector<uint32_t> entries(kRansSlots);
  for (uint32_t f = 1; f < kRansSlots; ++f) {
    const RansTable table{std::vector<uint64_t>{f, kRansSlots - f}};
    ASSERT_EQ(table.frequency(0), f);
    for (uint16_t& v : values) v = random.below(kRansSlots) < f ? 0 : 1;
    RansBlockWriter writer;
    writer.add_hybrid(&table, nullptr, values);
    Bytes block;
    writer.finish(block);
    RansLanes lanes;
    ASSERT_TRUE(open_rans_block(block, 0, &lanes).ok());
    table.expand(entries.data());
    rans_kernels_reference().hybrid(lanes, entries.data(), nullptr, got.size(), got.data());
    ASSERT_EQ(got, values) << f;
    ASSERT_TRUE(rans_block_finished(lanes)) << f;
  }
}

// A page of ten channels of codebook indices, against the entropy of what they were drawn from.
TEST(RansBlock, SizeIsCloseToTheEntropy) {
  constexpr size_t kEntries = 4096, kSymbols = 4096;
  for (const double mean : {100.0, 700.0, 2500.0}) {
    Random random(5);
    std::vector<double> p(kEntries);
    double sum = 0;
    for (size_t i = 0; i < kEntries; ++i) sum += p[i] = std::exp(-static_cast<double>(i) / mean);
    std::vector<double> cumulative(kEntries);
    for (size_t i = 0; i < kEntries; ++i) {
      p[i] /= sum;
      cumulative[i] = p[i] + (i > 0 ? cumulative[i - 1] : 0);
    }
    RansCase c;
    double bits = 0;
    for (int channel = 0; channel < 10; ++channel) {
      std::vector<uint16_t> values(kSymbols);
      for (uint16_t& v : values) {
        const auto at =
            std::upper_bound(cumulative.begin(), cumulative.end() - 1, random.uniform());
        v = static_cast<uint16_t>(at - cumulative.begin());
        bits -= std::log2(p[v]);
      }
      c.hybrid.push_back(channel_of(values));
    }
    const double bytes = static_cast<double>(c.block().size());
    EXPECT_LT(bytes, 1.005 * bits / 8) << "mean " << mean;
    EXPECT_GT(bytes, 0.99 * bits / 8) << "mean " << mean;
  }
}

// A writer starts anew after each block.
TEST(RansBlock, WritersCanBeUsedAgain) {
  RansCase first, second;
  first.hybrid.push_back(test::random_channel<uint16_t>(3000, test::Shape::kUniform, 0, 1));
  second.wide.push_back(test::random_channel<uint64_t>(77, test::Shape::kUniform, 2, 2));
  RansBlockWriter writer;
  Bytes out;
  writer.add_hybrid(first.hybrid[0].tables.data(), nullptr, first.hybrid[0].values);
  writer.finish(out);
  writer.add_wide(second.wide[0].tables.data(), second.wide[0].context_pointer(),
                  second.wide[0].values);
  writer.finish(out);  // appended
  Bytes want = first.block();
  const Bytes more = second.block();
  want.insert(want.end(), more.begin(), more.end());
  EXPECT_EQ(out, want);
}

}  // namespace
}  // namespace l4d
