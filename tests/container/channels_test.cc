// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/channels.h"

#include <gtest/gtest.h>

#include <numeric>

#include "tests/container/rans_columns.h"

namespace l4d {
namespace {

constexpr uint64_t kBase = 900;

// A table by its frequencies, as section 10.2 of the specification stores it.
Bytes table_bytes(const std::vector<uint64_t>& frequencies, uint64_t num_tokens) {
  Bytes out;
  append_vlq(num_tokens, out);
  for (size_t t = 0; t < frequencies.size(); ++t) {
    append_vlq(frequencies[t], out);
    if (frequencies[t] != 0) continue;
    size_t zeros = 0;
    while (t + 1 + zeros < frequencies.size() && frequencies[t + 1 + zeros] == 0) ++zeros;
    append_vlq(zeros, out);
    t += zeros;
  }
  return out;
}
Bytes table_bytes(const std::vector<uint64_t>& frequencies) {
  return table_bytes(frequencies, frequencies.size());
}

// num_tables, num_wide, tables, maps.
struct Chunk {
  uint64_t num_tables = 2, num_wide = 1;
  std::vector<Bytes> tables = {table_bytes({1024}), table_bytes({1000, 0, 0, 24})};
  Bytes map;

  Chunk(const SceneHeader& header, const LayerHeader& layer) {
    for (const ChannelSpec& p : page_channels(header, layer)) {
      map.insert(map.end(), p.contexts, p.kind == ChannelKind::kPosition ? uint8_t{0} : uint8_t{1});
    }
  }
  Bytes bytes() const {
    Bytes out;
    append_vlq(num_tables, out);
    append_vlq(num_wide, out);
    for (const Bytes& t : tables) out.insert(out.end(), t.begin(), t.end());
    out.insert(out.end(), map.begin(), map.end());
    return out;
  }
};

struct Expected {
  ChannelKind kind;
  unsigned component, index, contexts;
};

void expect_channels(const std::vector<Expected>& want, const std::vector<ChannelSpec>& got) {
  ASSERT_EQ(want.size(), got.size());
  for (size_t i = 0; i < want.size(); ++i) {
    EXPECT_EQ(want[i].kind, got[i].kind) << i;
    EXPECT_EQ(want[i].component, got[i].component) << i;
    EXPECT_EQ(want[i].index, got[i].index) << i;
    EXPECT_EQ(want[i].contexts, got[i].contexts) << i;
  }
}

// spec: PAGE-2
TEST(Channels, OrderAndContexts) {
  SceneHeader h = test::transform_header();
  h.sh = test::example_transform({2}, 1);
  LayerHeader& layer = h.layers[1];
  layer.component[L4D_COMPONENT_SCALE] = test::example_vq(4, 2, true, 1);
  const unsigned scale = L4D_COMPONENT_SCALE, spatial = L4D_COMPONENT_ROTOR_SPATIAL,
                 temporal = L4D_COMPONENT_ROTOR_TEMPORAL, sh = L4D_COMPONENT_SH;
  const std::vector<ChannelSpec> channels = page_channels(h, layer);
  expect_channels({{ChannelKind::kPosition, 0, 0, 1},
                   {ChannelKind::kMeanT, 0, 0, 1},
                   {ChannelKind::kOpacity, 0, 0, 1},
                   {ChannelKind::kScaleFactor, 0, 0, 1},
                   {ChannelKind::kDepth, scale, 0, 1},
                   {ChannelKind::kIndex, scale, 0, 1},
                   {ChannelKind::kIndex, scale, 1, 1},
                   {ChannelKind::kEscape, scale, 0, 1},
                   {ChannelKind::kEscape, scale, 1, 1},
                   {ChannelKind::kEscape, scale, 2, 1},
                   {ChannelKind::kEscape, scale, 3, 1},
                   {ChannelKind::kStepExponent, spatial, 0, 16},
                   {ChannelKind::kCoefficient, spatial, 0, 16},
                   {ChannelKind::kCoefficient, spatial, 1, 80},
                   {ChannelKind::kCoefficient, spatial, 2, 80},
                   {ChannelKind::kStepExponent, temporal, 0, 16},
                   {ChannelKind::kEobIndex, temporal, 0, 16},
                   {ChannelKind::kCoefficient, temporal, 0, 16},
                   {ChannelKind::kCoefficient, temporal, 1, 80},
                   {ChannelKind::kCoefficient, temporal, 2, 80},
                   {ChannelKind::kStepExponent, sh, 0, 16},
                   {ChannelKind::kCoefficient, sh, 0, 16},
                   {ChannelKind::kCoefficient, sh, 1, 80}},
                  channels);
  const SceneHeader bare = test::bare_header();
  expect_channels({{ChannelKind::kPosition, 0, 0, 1}}, page_channels(bare, bare.layers[0]));
}

// spec: section 13.2
TEST(Channels, DetailBeginsBehindTheBase) {
  SceneHeader h = test::transform_header();  // SH: step exponent, EOB index, 48 coefficients
  const std::vector<ChannelSpec> channels = page_channels(h, h.layers[1]);
  const size_t first = channels.size() - 50;
  ASSERT_EQ(channels[first].kind, ChannelKind::kStepExponent);
  EXPECT_EQ(first_detail_channel(h, channels), first);
  for (const unsigned base : {1u, 3u, 47u, 48u}) {
    h.sh_base = base;
    EXPECT_EQ(first_detail_channel(h, channels), first + 2 + base);
    EXPECT_EQ(h.has_sh_detail(), base < 48);
  }
  h = test::example_header();  // SH: depth, three stages, 27 numbers of escapes
  const std::vector<ChannelSpec> of_codebooks = page_channels(h, h.layers[1]);
  EXPECT_EQ(first_detail_channel(h, of_codebooks), of_codebooks.size() - 31);
  EXPECT_TRUE(h.has_sh_detail());
  h = test::bare_header();
  EXPECT_EQ(first_detail_channel(h, page_channels(h, h.layers[0])), 1u);
  EXPECT_FALSE(h.has_sh_detail());
}

TEST(Channels, MagnitudeContextsAreThoseOfTheSpecification) {
  for (unsigned sum = 0; sum < 70000; ++sum) {
    const unsigned want = sum == 0 ? 0 : sum < 3 ? 1 : sum < 7 ? 2 : sum < 15 ? 3 : 4;
    ASSERT_EQ(magnitude_context(sum), want) << sum;
  }
}

// spec: RANS-6
TEST(Channels, RawColumnsCannotBeCoded) {
  const SceneHeader valid = test::transform_header();
  EXPECT_TRUE(rans_codable(valid, valid.layers[1]));
  const auto codable_after = [&](auto&& edit) {
    SceneHeader h = valid;
    edit(h);
    return rans_codable(h, h.layers[1]);
  };
  EXPECT_FALSE(codable_after([](SceneHeader& h) { h.position = CoordinateCodingId::kRaw32; }));
  EXPECT_FALSE(codable_after([](SceneHeader& h) { h.opacity.coding = ScalarCodingId::kRaw32; }));
  EXPECT_FALSE(codable_after([](SceneHeader& h) { h.sh.coding = ComponentCodingId::kRaw32; }));
  EXPECT_FALSE(
      codable_after([](SceneHeader& h) { h.layers[1].mean_t = CoordinateCodingId::kRaw32; }));
  EXPECT_FALSE(codable_after(
      [](SceneHeader& h) { h.layers[1].scale_factor.coding = ScalarCodingId::kRaw32; }));
  for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
    EXPECT_FALSE(codable_after(
        [c](SceneHeader& h) { h.layers[1].component[c].coding = ComponentCodingId::kRaw32; }));
  }
  // Another layer's codings do not matter.
  EXPECT_TRUE(
      codable_after([](SceneHeader& h) { h.layers[2].mean_t = CoordinateCodingId::kRaw32; }));
}

TEST(EntropyTables, EverySlotHasItsToken) {
  for (const SceneHeader& header : test::rans_headers()) {
    for (const LayerHeader& layer : header.layers) {
      Chunk chunk(header, layer);
      std::vector<uint64_t> all(kRansHybridTokens, 1);
      all[7] += 1024 - all.size();
      chunk.tables.push_back(table_bytes(all));
      chunk.num_tables = 3;
      std::replace(chunk.map.begin() + 1, chunk.map.end(), uint8_t{1}, uint8_t{2});
      EntropyTables out;
      const Status s = parse_entropy_tables(chunk.bytes(), kBase, header, layer, &out);
      ASSERT_TRUE(s.ok()) << s.detail();
      ASSERT_EQ(out.entries.size(), 3 * kRansSlots);
      std::vector<uint32_t> want(kRansSlots);
      const std::vector<uint32_t> frequencies(all.begin(), all.end());
      expand_rans_table(frequencies.data(), frequencies.size(), want.data());
      for (size_t slot = 0; slot < kRansSlots; ++slot) {
        ASSERT_EQ(out.entries[2 * kRansSlots + slot], want[slot]) << slot;
      }
      ASSERT_EQ(out.maps.size(), out.channels.size());
      for (size_t p = 0; p < out.channels.size(); ++p) {
        EXPECT_EQ(out.maps[p].size(), out.channels[p].contexts);
        EXPECT_EQ(out.maps[p].front(), p == 0 ? 0 : 2);
      }
    }
  }
}

// spec: RANS-1, CHNK-7
TEST(EntropyTables, TruncatedAtEveryByteAndLongerByOne) {
  const SceneHeader h = test::transform_header();
  Bytes whole = Chunk(h, h.layers[1]).bytes();
  EntropyTables out;
  for (size_t cut = 0; cut < whole.size(); ++cut) {
    const Status s = parse_entropy_tables(ByteSpan(whole.data(), cut), kBase, h, h.layers[1], &out);
    ASSERT_EQ(s.code(), L4D_ERR_CORRUPT) << cut;
    ASSERT_STREQ(s.clause(), "RANS-1") << cut;
  }
  whole.push_back(0);
  const Status s = parse_entropy_tables(whole, kBase, h, h.layers[1], &out);
  EXPECT_STREQ(s.clause(), "CHNK-7");
  EXPECT_EQ(s.offset(), kBase + whole.size() - 1);
}

struct Rule {
  const char* clause;
  void (*edit)(Chunk&);
};
const Rule kRules[] = {
    {"RANS-2", [](Chunk& c) { c.tables[1] = table_bytes({}); }},
    {"RANS-2", [](Chunk& c) { c.tables[1] = table_bytes({1023}); }},
    {"RANS-2",
     [](Chunk& c) {
       c.tables[1] = table_bytes({1024, 1});
     }},
    {"RANS-2",
     [](Chunk& c) {
       c.tables[1] = table_bytes({1024, 0});
     }},
    {"RANS-2",
     [](Chunk& c) {
       c.tables[1] = table_bytes({1, 0, 0, 0, 1023}, 3);
     }},
    {"RANS-2",
     [](Chunk& c) {
       c.tables[1] = table_bytes({1, (uint64_t{1} << 62) + 1023});
     }},
    {"RANS-2",
     [](Chunk& c) {
       std::vector<uint64_t> f(kRansHybridTokens + 1, 0);
       f.back() = 1024;
       c.tables[1] = table_bytes(f);
     }},
    {"RANS-2",
     [](Chunk& c) {
       std::vector<uint64_t> f(kRansWideTokens + 1, 0);
       f.back() = 1024;
       c.tables[0] = table_bytes(f);
     }},
    {"RANS-4", [](Chunk& c) { c.map.front() = 1; }},
    {"RANS-4", [](Chunk& c) { c.map[1] = 0; }},
    {"RANS-4", [](Chunk& c) { c.map.back() = 2; }},
    {"RANS-4", [](Chunk& c) { c.map.back() = 255; }},
    {"RANS-5", [](Chunk& c) { c.num_tables = 0; }},
    {"RANS-5", [](Chunk& c) { c.num_tables = kMaxEntropyTables + 1; }},
    {"RANS-5", [](Chunk& c) { c.num_tables = uint64_t{1} << 62; }},
    {"RANS-5", [](Chunk& c) { c.num_wide = 0; }},
    {"RANS-5", [](Chunk& c) { c.num_wide = 3; }},
};

// spec: RANS-2, RANS-4, RANS-5
TEST(EntropyTables, EachRuleIsChecked) {
  const SceneHeader h = test::transform_header();
  for (const Rule& rule : kRules) {
    Chunk chunk(h, h.layers[1]);
    rule.edit(chunk);
    EntropyTables out;
    const Status s = parse_entropy_tables(chunk.bytes(), kBase, h, h.layers[1], &out);
    EXPECT_EQ(s.code(), L4D_ERR_CORRUPT) << rule.clause;
    EXPECT_STREQ(s.clause(), rule.clause) << s.detail() << ", rule " << &rule - kRules;
  }
}

// spec: CHNK-8
TEST(EntropyTables, TheLongestChunkIsNotLongerThanItsBound) {
  SceneHeader h = test::transform_header();
  const LayerHeader& layer = h.layers[1];
  Chunk chunk(h, layer);
  std::vector<uint64_t> wide(kRansWideTokens, 1), hybrid(kRansHybridTokens, 1);
  // Two bytes for as many frequencies as possible, and for each zero.
  for (size_t t = 0; t < 7; ++t) {
    wide[t] = 128;
    hybrid[t] = 128;
  }
  wide.back() = 0;
  wide.back() = 1024 - std::accumulate(wide.begin(), wide.end(), uint64_t{0});
  hybrid.back() = 0;
  hybrid.back() = 1024 - std::accumulate(hybrid.begin(), hybrid.end(), uint64_t{0});
  chunk.tables = {table_bytes(wide)};
  chunk.tables.resize(kMaxEntropyTables, table_bytes(hybrid));
  chunk.num_tables = kMaxEntropyTables;
  const Bytes raw = chunk.bytes();
  EntropyTables out;
  const Status s = parse_entropy_tables(raw, kBase, h, layer, &out);
  ASSERT_TRUE(s.ok()) << s.detail();
  EXPECT_LE(raw.size(), max_entropy_bytes(page_channels(h, layer)));
  EXPECT_LE(out.memory_bytes(), entropy_memory(raw, page_channels(h, layer)));
  size_t contexts = 0;
  for (const ChannelSpec& p : page_channels(h, layer)) contexts += p.contexts;
  EXPECT_EQ(max_entropy_bytes(page_channels(h, layer)), 65794 + contexts);
}

}  // namespace
}  // namespace l4d
