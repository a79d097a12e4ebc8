// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/directory.h"

#include <gtest/gtest.h>

#include <functional>

#include "libl4dcodec/base/hash.h"
#include "tests/common/flat.h"
#include "tests/common/headers.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using test::example_header;

// Of the example header's layer 2: level 3, 16 buckets, 4 per directory page, RCQ on scale.
constexpr uint32_t kLayer = 2;
constexpr uint32_t kIndex = 1;  // buckets 4..7

DirectoryPage example_page() {
  DirectoryPage d;
  d.blocks.resize(2);
  d.blocks[0].tables[L4D_COMPONENT_SCALE] = {33, {500, 1, 60, 61, 0}};
  d.blocks[1].tables[L4D_COMPONENT_SCALE] = {65536, {600, 2, 70, 71, 1}};
  const uint32_t buckets[] = {4, 4, 5, 7, 7, 7};
  const uint32_t blocks[] = {0, 0, kNoBlock, 1, 1, 1};
  for (uint32_t i = 0; i < 6; ++i) {
    PageRecord r;
    r.chunk = {1000 + 100 * i, 0x1111 * i, 40 + i, 80 + i, i % 3};
    if (i % 3 == 2) r.sh_detail = {2000 + 100 * i, 0x2222 * i, 130 + i, 130 + i, 2};
    r.num_gaussians = i == 0 ? 1 : i == 1 ? 65536 : 10 * i;
    r.bucket = buckets[i];
    r.block = blocks[i];
    r.visible_begin = static_cast<uint8_t>(10 * i);
    r.visible_end = static_cast<uint8_t>(i == 5 ? 50 : 255 - i);
    for (unsigned k = 0; k < 6; ++k) r.bounds[k] = static_cast<uint16_t>(0x3c00 + 6 * i + k);
    d.pages.push_back(r);
  }
  return d;
}

Status parse(const Bytes& bytes, DirectoryPage* out, uint32_t layer = kLayer,
             uint32_t index = kIndex) {
  return parse_directory_page(bytes, 900, example_header(), layer, index, out);
}

TEST(PageTableEntry, RoundTripAndProtection) {
  PageTableEntry entry;
  entry.chunk = {0x0102030405060708u, 0x1112131415161718u, 0x21222324, 0x31323334, 1};
  Bytes bytes;
  entry.append(bytes);
  ASSERT_EQ(bytes.size(), PageTableEntry::kBytes);
  PageTableEntry back;
  ASSERT_TRUE(PageTableEntry::parse(bytes, 0, &back).ok());
  EXPECT_EQ(back.chunk.offset, entry.chunk.offset);
  EXPECT_EQ(back.chunk.hash, entry.chunk.hash);
  EXPECT_EQ(back.chunk.stored_bytes, entry.chunk.stored_bytes);
  EXPECT_EQ(back.chunk.raw_bytes, entry.chunk.raw_bytes);
  EXPECT_EQ(back.chunk.codec, entry.chunk.codec);
  // spec: DIR-1
  for (size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    Bytes damaged = bytes;
    damaged[bit / 8] = static_cast<unsigned char>(damaged[bit / 8] ^ (1u << (bit % 8)));
    const Status s = PageTableEntry::parse(damaged, 77, &back);
    EXPECT_EQ(s.code(), L4D_ERR_CHECKSUM);
    EXPECT_STREQ(s.clause(), "DIR-1");
    EXPECT_EQ(s.offset(), 77u);
  }
}

TEST(Directory, NumberOfPages) {
  LayerHeader l;
  EXPECT_EQ(num_directory_pages(l), 1u);
  l.level = 3;  // 16 buckets
  EXPECT_EQ(num_directory_pages(l), 16u);
  l.directory_bits = 2;
  EXPECT_EQ(num_directory_pages(l), 4u);
  l.directory_bits = 4;
  EXPECT_EQ(num_directory_pages(l), 1u);
  l.directory_bits = 16;
  EXPECT_EQ(num_directory_pages(l), 1u);
  l.level = 24;
  l.directory_bits = 0;
  EXPECT_EQ(num_directory_pages(l), 1u << 25);
}

TEST(Directory, RoundTrip) {
  const DirectoryPage a = example_page();
  DirectoryPage b;
  const Status s = parse(serialize_directory_page(a, kLayer, kIndex), &b);
  ASSERT_TRUE(s.ok()) << s.detail();
  const uint64_t payload = example_header().payload_offset;
  ASSERT_EQ(b.pages.size(), a.pages.size());
  for (size_t i = 0; i < a.pages.size(); ++i) {
    const PageRecord& x = a.pages[i];
    const PageRecord& y = b.pages[i];
    EXPECT_EQ(y.chunk.offset, payload + x.chunk.offset);
    EXPECT_EQ(y.chunk.hash, x.chunk.hash);
    EXPECT_EQ(y.chunk.stored_bytes, x.chunk.stored_bytes);
    EXPECT_EQ(y.chunk.raw_bytes, x.chunk.raw_bytes);
    EXPECT_EQ(y.chunk.codec, x.chunk.codec);
    EXPECT_EQ(y.has_sh_detail(), i % 3 == 2);
    EXPECT_EQ(y.sh_detail.offset, i % 3 == 2 ? payload + x.sh_detail.offset : 0);
    EXPECT_EQ(y.sh_detail.hash, x.sh_detail.hash);
    EXPECT_EQ(y.sh_detail.stored_bytes, x.sh_detail.stored_bytes);
    EXPECT_EQ(y.num_gaussians, x.num_gaussians);
    EXPECT_EQ(y.bucket, x.bucket);
    EXPECT_EQ(y.block, x.block);
    EXPECT_EQ(y.visible_begin, x.visible_begin);
    EXPECT_EQ(y.visible_end, x.visible_end);
    EXPECT_EQ(y.bounds, x.bounds);
  }
  ASSERT_EQ(b.blocks.size(), 2u);
  for (size_t i = 0; i < 2; ++i) {
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      const RcqTableRef& x = a.blocks[i].tables[c];
      const RcqTableRef& y = b.blocks[i].tables[c];
      EXPECT_EQ(y.num_entries, x.num_entries);
      if (x.num_entries == 0) continue;
      EXPECT_EQ(y.chunk.offset, payload + x.chunk.offset);
      EXPECT_EQ(y.chunk.hash, x.chunk.hash);
      EXPECT_EQ(y.chunk.stored_bytes, x.chunk.stored_bytes);
      EXPECT_EQ(y.chunk.raw_bytes, x.chunk.raw_bytes);
      EXPECT_EQ(y.chunk.codec, x.chunk.codec);
    }
  }
}

TEST(Directory, BytesDoNotDependOnThePayloadOffset) {
  // Two files with different headers share their directory pages.
  const Bytes bytes = serialize_directory_page(example_page(), kLayer, kIndex);
  SceneHeader moved = example_header();
  moved.payload_offset += 12345;
  DirectoryPage a, b;
  ASSERT_TRUE(parse(bytes, &a).ok());
  ASSERT_TRUE(parse_directory_page(bytes, 0, moved, kLayer, kIndex, &b).ok());
  EXPECT_EQ(b.pages[3].chunk.offset, a.pages[3].chunk.offset + 12345);
}

struct Rule {
  const char* clause;
  std::function<void(DirectoryPage&)> change;
};

// spec: DIR-3, DIR-4, DIR-6, DIR-7, DIR-8, DIR-12, RCQ-3, RCQ-4
TEST(Directory, EveryRuleIsChecked) {
  const Rule kRules[] = {
      {"DIR-3", [](DirectoryPage& d) { d.pages[0].bucket = 3; }},
      {"DIR-3", [](DirectoryPage& d) { d.pages[5].bucket = 8; }},
      {"DIR-3", [](DirectoryPage& d) { std::swap(d.pages[1], d.pages[2]); }},
      {"DIR-3", [](DirectoryPage& d) { d.pages[5].bucket = ~0u; }},
      {"DIR-4", [](DirectoryPage& d) { d.pages[2].num_gaussians = 0; }},
      {"DIR-4", [](DirectoryPage& d) { d.pages[2].num_gaussians = 65537; }},
      {"DIR-6", [](DirectoryPage& d) { d.pages[2].block = 2; }},
      {"DIR-6", [](DirectoryPage& d) { d.pages[2].block = kNoBlock - 1; }},
      {"DIR-7", [](DirectoryPage& d) { d.pages[2].visible_begin = 254; }},
      {"DIR-8", [](DirectoryPage& d) { d.pages[1].block = kNoBlock; }},
      {"DIR-8", [](DirectoryPage& d) { d.pages[4].block = 0; }},
      {"DIR-12", [](DirectoryPage& d) { d.pages[3].bounds[1] = 0x7c00; }},
      {"DIR-12", [](DirectoryPage& d) { d.pages[3].bounds[5] = 0x7e01; }},
      {"DIR-12", [](DirectoryPage& d) { d.pages[3].bounds[0] = 0x4800; }},  // above the greatest
      {"RCQ-3",
       [](DirectoryPage& d) {
         d.blocks[0].tables[L4D_COMPONENT_SH] = {3, {500, 1, 60, 61, 0}};
       }},
      {"RCQ-3",
       [](DirectoryPage& d) {
         d.blocks[1].tables[L4D_COMPONENT_ROTOR_SPATIAL] = {3, {500, 1, 60, 61, 0}};
       }},
      {"RCQ-4",
       [](DirectoryPage& d) { d.blocks[1].tables[L4D_COMPONENT_SCALE].num_entries = 65537; }},
  };
  for (const Rule& rule : kRules) {
    DirectoryPage page = example_page();
    rule.change(page);
    DirectoryPage parsed;
    const Status s = parse(serialize_directory_page(page, kLayer, kIndex), &parsed);
    EXPECT_EQ(s.code(), L4D_ERR_CORRUPT) << rule.clause;
    EXPECT_STREQ(s.clause(), rule.clause) << s.detail();
    EXPECT_EQ(s.offset(), 900u);
  }
}

// Block ids handed out by a decoder hold the block in 8 bits, so with more of them two blocks of a
// layer would look like one. spec: DIR-11
TEST(Directory, MoreThan256BlocksAreRefused) {
  for (const size_t blocks : {size_t{256}, size_t{257}}) {
    DirectoryPage page = example_page();
    page.blocks.resize(blocks, page.blocks[0]);
    DirectoryPage parsed;
    const Status s = parse(serialize_directory_page(page, kLayer, kIndex), &parsed);
    EXPECT_EQ(s.ok(), blocks == 256) << blocks << " blocks: " << s.detail();
    if (!s.ok()) {
      EXPECT_STREQ(s.clause(), "DIR-11");
    }
  }
}

// spec: RCQ-5
TEST(Directory, TwoTablesOfOneComponentAreRefused) {
  SceneHeader header = example_header();
  header.layers[kLayer].component[L4D_COMPONENT_ROTOR_SPATIAL].has_rcq = true;
  DirectoryPage page = example_page();
  page.blocks[1].tables[L4D_COMPONENT_ROTOR_SPATIAL] = {9, {500, 1, 60, 61, 0}};
  Bytes bytes = serialize_directory_page(page, kLayer, kIndex);
  DirectoryPage parsed;
  ASSERT_TRUE(parse_directory_page(bytes, 0, header, kLayer, kIndex, &parsed).ok());
  test::repeat_component(bytes, 1);
  const Status s = parse_directory_page(bytes, 0, header, kLayer, kIndex, &parsed);
  EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
  EXPECT_STREQ(s.clause(), "RCQ-5") << s.detail();
}

// spec: DIR-13
TEST(Directory, ShChunksWhereNoneCanBeAreRefused) {
  const auto clause_of = [](const SceneHeader& header, auto&& edit) {
    DirectoryPage page = example_page(), parsed;
    edit(page.pages);
    return std::string(parse_directory_page(serialize_directory_page(page, kLayer, kIndex), 0,
                                            header, kLayer, kIndex, &parsed)
                           .clause());
  };
  using Pages = std::vector<PageRecord>;
  const SceneHeader header = example_header();
  EXPECT_EQ(clause_of(header, [](Pages&) {}), "");
  EXPECT_EQ(clause_of(header, [](Pages& p) { p[2].sh_detail.stored_bytes = 0; }), "DIR-13");
  EXPECT_EQ(clause_of(header, [](Pages& p) { p[0].sh_detail.offset = 1; }), "DIR-13");
  EXPECT_EQ(clause_of(header, [](Pages& p) { p[1].sh_detail.hash = 1; }), "DIR-13");
  for (const size_t of_streams : {size_t{0}, size_t{1}}) {
    EXPECT_EQ(clause_of(header, [&](Pages& p) { p[of_streams].sh_detail = p[2].sh_detail; }),
              "DIR-13");
  }
  // Of codecs to come this decoder knows nothing.
  EXPECT_EQ(clause_of(header, [](Pages& p) { p[2].chunk.codec = 99; }), "");
  SceneHeader whole = header;
  whole.sh = ComponentCoding();
  EXPECT_EQ(clause_of(whole, [](Pages&) {}), "DIR-13");
  whole.sh = ComponentCoding();
  whole.sh.coding = ComponentCodingId::kTransform;
  whole.sh.steps = {1.0f, 1.0f};
  whole.sh_base = 1;
  EXPECT_EQ(clause_of(whole, [](Pages&) {}), "");
  whole.sh_base = 2;
  EXPECT_EQ(clause_of(whole, [](Pages&) {}), "DIR-13");
}

// spec: CHNK-1
TEST(Directory, OffsetsBeyondEveryFileAreRefused) {
  for (const int what : {0, 1, 2}) {
    DirectoryPage page = example_page();
    ChunkRef* const refs[] = {&page.blocks[1].tables[L4D_COMPONENT_SCALE].chunk,
                              &page.pages[4].chunk, &page.pages[5].sh_detail};
    refs[what]->offset = ~uint64_t{0} - 100;
    DirectoryPage parsed;
    const Status s = parse(serialize_directory_page(page, kLayer, kIndex), &parsed);
    EXPECT_FALSE(s.ok());
    EXPECT_STREQ(s.clause(), "CHNK-1");
  }
}

// spec: DIR-2
TEST(Directory, PagesOfOtherPlacesAreRefused) {
  const DirectoryPage page = example_page();
  DirectoryPage parsed;
  for (const auto& [layer, index] : {std::pair<uint32_t, uint32_t>{1, 1}, {2, 0}, {2, 2}}) {
    const Status s = parse(serialize_directory_page(page, layer, index), &parsed);
    EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
    EXPECT_STREQ(s.clause(), "DIR-2");
  }
  EXPECT_TRUE(parse(serialize_directory_page(page, kLayer, kIndex), &parsed).ok());
}

// spec: DIR-2
TEST(Directory, RecordsOutOfAlignmentAreRefused) {
  const Bytes bytes = serialize_directory_page(example_page(), kLayer, kIndex);
  const size_t root = load_le<uint32_t>(bytes.data());
  const size_t vtable = root - load_le<uint32_t>(bytes.data() + root);
  constexpr size_t kPagesInVtable = 8;
  const size_t field = root + load_le<uint16_t>(bytes.data() + vtable + kPagesInVtable);
  const size_t pages = field + load_le<uint32_t>(bytes.data() + field);
  const size_t pages_bytes = 4 + 72 * load_le<uint32_t>(bytes.data() + pages);
  for (const size_t shift : {size_t{0}, size_t{4}}) {
    // The same records again, at the end, and the page's root refers to those.
    Bytes moved = bytes;
    moved.resize((bytes.size() + 7) / 8 * 8 + 4 + shift);
    store_le(static_cast<uint32_t>(moved.size() - field), moved.data() + field);
    moved.insert(moved.end(), bytes.begin() + static_cast<std::ptrdiff_t>(pages),
                 bytes.begin() + static_cast<std::ptrdiff_t>(pages + pages_bytes));
    DirectoryPage parsed;
    const Status s = parse(moved, &parsed);
    if (shift == 0) {
      ASSERT_TRUE(s.ok()) << s.message();
      ASSERT_EQ(parsed.pages.size(), example_page().pages.size());
    } else {
      ASSERT_EQ(s.code(), L4D_ERR_CORRUPT);
      ASSERT_STREQ(s.clause(), "DIR-2");
    }
  }
}

// spec: DIR-2
TEST(Directory, TruncatedAtEveryLength) {
  const Bytes bytes = serialize_directory_page(example_page(), kLayer, kIndex);
  for (size_t n = 0; n + 8 < bytes.size(); ++n) {
    const Bytes cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n));
    DirectoryPage parsed;
    ASSERT_STREQ(parse(cut, &parsed).clause(), "DIR-2") << n;
  }
}

TEST(Directory, DamagedBytesAreRefusedOrParsedSafely) {
  const Bytes bytes = serialize_directory_page(example_page(), kLayer, kIndex);
  test::Random random(11);
  for (int round = 0; round < 20000; ++round) {
    Bytes damaged = bytes;
    for (uint32_t k = random.below(3); k < 3; ++k) {
      damaged[random.below(static_cast<uint32_t>(damaged.size()))] =
          static_cast<unsigned char>(random.bits());
    }
    DirectoryPage parsed;
    const Status s = parse(damaged, &parsed);
    if (!s.ok()) {
      ASSERT_EQ(s.code(), L4D_ERR_CORRUPT);
      ASSERT_STRNE(s.clause(), "");
      continue;
    }
    for (const PageRecord& p : parsed.pages) {
      ASSERT_TRUE(p.bucket >= 4 && p.bucket < 8);
      ASSERT_TRUE(p.block == kNoBlock || p.block < parsed.blocks.size());
      ASSERT_TRUE(p.num_gaussians >= 1 && p.num_gaussians <= 65536);
    }
  }
}

}  // namespace
}  // namespace l4d
