// SPDX-License-Identifier: Apache-2.0
#include <numeric>

#include "encoder/file/entropy_model.h"
#include "libl4dcodec/entropy/rans.h"
#include "tests/container/rans_columns.h"

namespace l4d {
namespace {

using test::expect_columns;
using test::Random;
using test::rans_columns;
using test::rans_headers;

constexpr uint64_t kBase = 5000;
// Around the number of lanes, and many groups of them.
constexpr size_t kCounts[] = {1, 31, 32, 33, 5000};

// A layer's tables from the statistics of some columns, and pages coded with them.
struct Coded {
  EntropyModel model;
  EntropyTables tables;

  static EntropyModel model_of(const SceneHeader& header, const LayerHeader& layer,
                               const std::vector<PageColumns>& pages) {
    const std::vector<ChannelSpec> channels = page_channels(header, layer);
    TokenCounts all(channels);
    for (const PageColumns& page : pages) {
      TokenCounts counts(channels);
      visit_channels(header, layer, channels, page, counts);
      all.add(counts);
    }
    return EntropyModel(channels, all);
  }

  Coded(const SceneHeader& header, const LayerHeader& layer, const std::vector<PageColumns>& pages)
      : model(model_of(header, layer, pages)) {
    const Status s = parse_entropy_tables(model.serialize(), kBase, header, layer, &tables);
    EXPECT_TRUE(s.ok()) << s.detail();
  }
};

struct Kernels {
  const RansKernels& rans;
  const StreamKernels& streams;
};
const Kernels kBackends[] = {{rans_kernels_reference(), stream_kernels_reference()},
                             {rans_kernels_simd(), stream_kernels_simd()}};

// A page as the model coded it; without an SH chunk all channels are in the base chunk.
struct Page {
  Bytes first, detail;

  RansPageChunks parts() const {
    RansPageChunks p;
    p.first = first;
    p.first_at = kBase;
    p.has_detail = !detail.empty();
    p.detail = detail;
    p.detail_at = kBase + 100000;
    return p;
  }
};
Page page_of(const EntropyModel& model, const SceneHeader& header, const LayerHeader& layer,
             const PageColumns& columns, bool split) {
  Page page;
  page.first = model.encode_page(header, layer, columns, split ? &page.detail : nullptr);
  return page;
}

RansDecoder decoder_of(const Kernels& kernels) {
  RansDecoder decoder;
  decoder.kernels = &kernels.rans;
  decoder.streams = &kernels.streams;
  return decoder;
}

class Parser {
 public:
  explicit Parser(const Kernels& kernels) : decoder_(decoder_of(kernels)) {}
  // The failure of either part.
  Status operator()(const Page& page, const SceneHeader& header, const LayerHeader& layer,
                    const EntropyTables& tables, const BlockRecord* block, size_t n,
                    bool with_detail, PageColumns* out, SectionBytes* sections = nullptr,
                    const PageWants& wants = {}) {
    Status detail;
    const bool decodes = with_detail && !page.detail.empty();
    RansPage coded{&decoder_, page.parts(), block, n, out, sections, decodes ? &detail : nullptr};
    decode_rans_page(header, layer, tables, wants, &coded);
    return coded.status.ok() ? detail : coded.status;
  }

 private:
  RansDecoder decoder_;  // reused, as decoders do
};

// spec: DEC-3, PAGE-2
TEST(RansPage, RoundTripInEveryCoding) {
  BlockRecord block;
  block.tables[L4D_COMPONENT_SCALE].num_entries = 700;
  for (const Kernels& kernels : kBackends) {
    Parser parse(kernels);
    PageColumns reused;  // nothing of one page may leak into the next
    uint64_t seed = 0;
    for (const SceneHeader& header : rans_headers()) {
      for (const LayerHeader& layer : header.layers) {
        const bool rcq = layer.component[L4D_COMPONENT_SCALE].has_rcq;
        std::vector<PageColumns> pages;
        for (const size_t n : kCounts) {
          pages.push_back(rans_columns(header, layer, rcq ? &block : nullptr, n, ++seed));
        }
        const Coded coded(header, layer, pages);
        for (const PageColumns& columns : pages) {
          for (const bool split : {false, true}) {
            SCOPED_TRACE(columns.n);
            const Page page = page_of(coded.model, header, layer, columns, split);
            EXPECT_EQ(page.detail.empty(), !split || !header.has_sh_detail());
            for (const bool with_detail : {true, false}) {
              SectionBytes sections{};
              const Status s = parse(page, header, layer, coded.tables, rcq ? &block : nullptr,
                                     columns.n, with_detail, &reused, &sections);
              ASSERT_TRUE(s.ok()) << s.detail();
              expect_columns(header, layer, with_detail || page.detail.empty(), columns, reused);
              EXPECT_LE(std::accumulate(sections.begin(), sections.end(), uint64_t{0}),
                        page.first.size() + (with_detail ? page.detail.size() : 0));
            }
          }
        }
      }
    }
  }
}

// With or without SH chunks, and whatever is damaged in one of them.
TEST(RansPage, TwoAtOnceAreAsEachAlone) {
  uint64_t seed = 0;
  const auto cut = [](Bytes Page::*part, Page page) {
    if (!(page.*part).empty()) (page.*part).resize((page.*part).size() / 2);
    return page;
  };
  for (const SceneHeader& header : rans_headers()) {
    for (const LayerHeader& layer : header.layers) {
      // Some channels of the first have no symbols.
      const PageColumns columns[2] = {rans_columns(header, layer, nullptr, 2, ++seed),
                                      rans_columns(header, layer, nullptr, 700, ++seed)};
      const Coded coded(header, layer, {columns[0], columns[1]});
      std::vector<Page> forms[2];
      for (size_t p = 0; p < 2; ++p) {
        for (const bool split : {false, true}) {
          const Page page = page_of(coded.model, header, layer, columns[p], split);
          forms[p].insert(forms[p].end(),
                          {page, cut(&Page::first, page), cut(&Page::detail, page)});
        }
      }
      for (const Kernels& kernels : kBackends) {
        Parser parse(kernels);
        RansDecoder decoders[2] = {decoder_of(kernels), decoder_of(kernels)};
        for (const Page& first : forms[0]) {
          for (const Page& second : forms[1]) {
            const Page* const pages[2] = {&first, &second};
            PageColumns got[2];
            Status detail[2];
            RansPage coding[2];
            for (size_t p = 0; p < 2; ++p) {
              coding[p] = {&decoders[p], pages[p]->parts(), nullptr, columns[p].n, &got[p]};
              if (!pages[p]->detail.empty()) coding[p].detail = &detail[p];
            }
            decode_rans_pages(header, layer, coded.tables, PageWants(), &coding[0], &coding[1]);
            for (size_t p = 0; p < 2; ++p) {
              PageColumns alone;
              const Status want = parse(*pages[p], header, layer, coded.tables, nullptr,
                                        columns[p].n, true, &alone);
              const Status& own = coding[p].status.ok() ? detail[p] : coding[p].status;
              ASSERT_EQ(own.ok() ? "" : own.detail(), want.ok() ? "" : want.detail());
              ASSERT_EQ(got[p].sh_detail, alone.sh_detail);
              ASSERT_EQ(got[p].symbols, alone.symbols);
              if (want.ok()) expect_columns(header, layer, true, columns[p], got[p]);
            }
          }
        }
      }
    }
  }
}

// The other form of a page holds the same columns.
TEST(RansPage, StreamsHoldTheSameColumns) {
  StreamEncoder encoder(1);
  StreamDecoder decoder;
  uint64_t seed = 50;
  for (const Kernels& kernels : kBackends) {
    decoder.kernels = &kernels.streams;
    PageColumns reused;
    for (const SceneHeader& header : rans_headers()) {
      for (const LayerHeader& layer : header.layers) {
        for (const size_t n : kCounts) {
          const PageColumns columns = rans_columns(header, layer, nullptr, n, ++seed);
          const Bytes raw = encode_page(encoder, header, layer, nullptr, columns);
          EXPECT_LE(raw.size(), max_page_bytes(header, n));
          const Status s = decode_page(decoder, raw, kBase, header, layer, nullptr, n, PageWants(),
                                       &reused, nullptr);
          ASSERT_TRUE(s.ok()) << s.detail();
          expect_columns(header, layer, true, columns, reused);
        }
      }
    }
  }
}

// One page of 33 Gaussians for tests that damage it.
struct Sample {
  SceneHeader header;
  const LayerHeader& layer;
  PageColumns columns;
  Coded coded;
  Parser parse{kBackends[1]};

  explicit Sample(unsigned sh_base = 3)
      : header(header_of(sh_base)),
        layer(header.layers[1]),
        columns(rans_columns(header, layer, nullptr, 33, 7)),
        coded(header, layer, {columns}) {}
  static SceneHeader header_of(unsigned sh_base) {
    SceneHeader h = test::transform_header();
    h.sh_base = sh_base;
    return h;
  }

  Page page(bool split) const { return page_of(coded.model, header, layer, columns, split); }
  Status decode(const Page& page, bool with_detail = true) {
    PageColumns out;
    return parse(page, header, layer, coded.tables, nullptr, columns.n, with_detail, &out);
  }
};

// spec: DEC-3
TEST(RansPage, ChannelsBehindTheLastThatIsWantedStayCoded) {
  Sample sample;
  const Page page = sample.page(false);
  Page shorter = page;
  shorter.first.resize(page.first.size() - 2);  // which coefficients of SH take
  const auto only = [](bool PageWants::*attribute) {
    PageWants wants{false, false, false, false, false, false, false};
    wants.*attribute = true;
    return wants;
  };
  const auto decode = [&](const Page& p, const PageWants& wants, PageColumns* out) {
    return sample.parse(p, sample.header, sample.layer, sample.coded.tables, nullptr,
                        sample.columns.n, true, out, nullptr, wants);
  };
  PageColumns out;
  EXPECT_STREQ(decode(shorter, PageWants(), &out).clause(), "RANS-7");
  EXPECT_STREQ(decode(shorter, only(&PageWants::sh), &out).clause(), "RANS-7");
  for (bool PageWants::*attribute : {&PageWants::position, &PageWants::mean_t, &PageWants::opacity,
                                     &PageWants::scale, &PageWants::rotor}) {
    PageColumns part;
    EXPECT_TRUE(decode(shorter, only(attribute), &part).ok());
    for (size_t axis = 0; axis < 3; ++axis) {
      EXPECT_EQ(part.fixed_position[axis], sample.columns.fixed_position[axis]);
    }
    // What lies behind was not touched.
    EXPECT_TRUE(part.component[L4D_COMPONENT_SH].step_exponent.empty());
    EXPECT_EQ(part.opacity.empty(),
              attribute == &PageWants::position || attribute == &PageWants::mean_t);
  }
  ASSERT_TRUE(decode(page, only(&PageWants::sh), &out).ok());
  expect_columns(sample.header, sample.layer, true, sample.columns, out);
}

// spec: RANS-1, RANS-7
TEST(RansPage, TruncatedAtEveryByteAndLonger) {
  Sample sample;
  for (const bool split : {false, true}) {
    const Page page = sample.page(split);
    for (Bytes Page::*part : {&Page::first, &Page::detail}) {
      const Bytes& whole = page.*part;
      // Those coefficients of SH that come last break no other rule.
      const bool ends_with_sh = !split || part == &Page::detail;
      for (size_t cut = part == &Page::first ? 0 : 1; cut < whole.size(); ++cut) {
        Page shorter = page;
        (shorter.*part).resize(cut);
        const Status s = sample.decode(shorter);
        ASSERT_EQ(s.code(), L4D_ERR_CORRUPT) << cut;
        if (cut < kRansStateBytes) {
          ASSERT_STREQ(s.clause(), "RANS-1") << cut << " of " << whole.size();
        } else if (ends_with_sh && cut + 3 > whole.size()) {
          ASSERT_STREQ(s.clause(), "RANS-7") << cut << " of " << whole.size();
        }
      }
      if (whole.empty()) continue;
      for (const size_t more : {size_t{1}, size_t{2}, size_t{3}, size_t{128}}) {
        Page longer = page;
        (longer.*part).resize(whole.size() + more);
        EXPECT_STREQ(sample.decode(longer).clause(), "RANS-7") << more;
      }
    }
  }
}

// spec: RANS-3
TEST(RansPage, StatesBelowTheLeastAreRefused) {
  Sample sample;
  const Page page = sample.page(true);
  for (Bytes Page::*part : {&Page::first, &Page::detail}) {
    for (size_t lane = 0; lane < kRansLanes; ++lane) {
      Page changed = page;
      const auto at =
          (changed.*part).begin() + static_cast<std::ptrdiff_t>(lane * sizeof(uint32_t));
      std::fill_n(at, 2, uint8_t{0xff});
      std::fill_n(at + 2, 2, uint8_t{0});
      const Status s = sample.decode(changed);
      EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
      EXPECT_STREQ(s.clause(), "RANS-3") << lane;
    }
  }
}

// spec: DEC-3
TEST(RansPage, DamageInAShChunkCostsNothingElse) {
  for (const unsigned sh_base : {0u, 1u, 3u, 11u, 47u}) {
    Sample sample(sh_base);
    const Page page = sample.page(true);
    Page changed = page;
    std::fill(changed.detail.begin(), changed.detail.end(), uint8_t{0});
    EXPECT_STREQ(sample.decode(changed).clause(), "RANS-3");
    EXPECT_TRUE(sample.decode(changed, false).ok());
    // Also where it shows only when all of it is decoded.
    changed = page;
    changed.detail.resize(changed.detail.size() + 2);
    PageColumns out;
    const Status s = sample.parse(changed, sample.header, sample.layer, sample.coded.tables,
                                  nullptr, sample.columns.n, true, &out);
    EXPECT_STREQ(s.clause(), "RANS-7");
    EXPECT_GE(s.offset(), page.parts().detail_at);
    EXPECT_FALSE(out.sh_detail);
    PageColumns base;
    ASSERT_TRUE(sample
                    .parse(page, sample.header, sample.layer, sample.coded.tables, nullptr,
                           sample.columns.n, false, &base)
                    .ok());
    expect_columns(sample.header, sample.layer, false, sample.columns, base);
    for (unsigned k = 0; k < sh_base; ++k) {
      EXPECT_EQ(out.component[L4D_COMPONENT_SH].coefficient[k],
                base.component[L4D_COMPONENT_SH].coefficient[k]);
    }
  }
}

// Pages with any integers, whether they keep the rules or not: one table for wide ones and one for
// the others have all tokens.
class AnyPage : public ChannelVisitor {
 public:
  AnyPage(const SceneHeader& header, const LayerHeader& layer, const PageColumns& columns)
      : header_(header), layer_(layer), channels_(page_channels(header, layer)) {
    visit_channels(header, layer, channels_, columns, *this);
  }

  void visit(const ChannelSymbols& s) override {
    wide_.emplace_back(s.wide.begin(), s.wide.end());
    hybrid_.emplace_back(s.hybrid.begin(), s.hybrid.end());
  }

  void put(ChannelKind kind, unsigned component, size_t i, uint64_t value) {
    for (size_t p = 0; p < channels_.size(); ++p) {
      if (channels_[p].kind != kind || channels_[p].component != component) continue;
      if (kind == ChannelKind::kPosition) {
        wide_[p].at(i) = value;
      } else {
        hybrid_[p].at(i) = static_cast<uint16_t>(value);
      }
      return;
    }
    FAIL() << "no such channel";
  }

  Bytes tables() const {
    Bytes out = {2, 1};
    wide_table_.append_to(out);
    hybrid_table_.append_to(out);
    for (const ChannelSpec& p : channels_) {
      out.insert(out.end(), p.contexts, p.kind == ChannelKind::kPosition ? uint8_t{0} : uint8_t{1});
    }
    return out;
  }

  Status decode(Parser& parse, PageColumns* out) const {
    EntropyTables entropy;
    const Status s = parse_entropy_tables(tables(), kBase, header_, layer_, &entropy);
    if (!s.ok()) return s;
    RansBlockWriter writer;
    for (size_t p = 0; p < channels_.size(); ++p) {
      if (channels_[p].kind == ChannelKind::kPosition) {
        writer.add_wide(&wide_table_, nullptr, wide_[p]);
      } else {
        writer.add_hybrid(&hybrid_table_, nullptr, hybrid_[p]);
      }
    }
    Page page;
    writer.finish(page.first);
    return parse(page, header_, layer_, entropy, nullptr, wide_[0].size(), true, out);
  }

 private:
  static RansTable all_tokens(size_t count) { return RansTable(std::vector<uint64_t>(count, 1)); }

  const SceneHeader& header_;
  const LayerHeader& layer_;
  std::vector<ChannelSpec> channels_;
  std::vector<std::vector<uint64_t>> wide_;
  std::vector<std::vector<uint16_t>> hybrid_;
  RansTable wide_table_ = all_tokens(kRansWideTokens);
  RansTable hybrid_table_ = all_tokens(kRansHybridTokens);
};

struct Rule {
  const char* clause;
  ChannelKind kind;
  unsigned component;
  size_t i;
  uint64_t value;
};

void expect_rules(const SceneHeader& header, const LayerHeader& layer,
                  const std::vector<Rule>& rules) {
  for (const Kernels& kernels : kBackends) {
    Parser parse(kernels);
    const PageColumns columns = rans_columns(header, layer, nullptr, 33, 3);
    const AnyPage valid(header, layer, columns);
    PageColumns out;
    const Status whole = valid.decode(parse, &out);
    ASSERT_TRUE(whole.ok()) << whole.detail();
    expect_columns(header, layer, true, columns, out);
    for (const Rule& rule : rules) {
      AnyPage page = valid;
      page.put(rule.kind, rule.component, rule.i, rule.value);
      const Status s = page.decode(parse, &out);
      EXPECT_EQ(s.code(), L4D_ERR_CORRUPT) << rule.clause;
      EXPECT_STREQ(s.clause(), rule.clause) << s.detail();
      EXPECT_GE(s.offset(), kBase);
    }
  }
}

// spec: RANS-8, STRM-3, TRAN-5, TRAN-6, VAL-1
TEST(RansPage, RulesOfTransformsAndFixedPositions) {
  const SceneHeader h = test::transform_header();
  const unsigned scale = L4D_COMPONENT_SCALE, spatial = L4D_COMPONENT_ROTOR_SPATIAL;
  const uint64_t end = uint64_t{1} << 63;
  expect_rules(h, h.layers[1],
               {{"TRAN-5", ChannelKind::kStepExponent, L4D_COMPONENT_SH, 32, 16},
                {"TRAN-5", ChannelKind::kStepExponent, spatial, 0, 65535},
                {"TRAN-6", ChannelKind::kEobIndex, L4D_COMPONENT_SH, 31, 5},
                {"TRAN-6", ChannelKind::kEobIndex, scale, 0, 4},
                {"STRM-3", ChannelKind::kOpacity, 0, 5, 256},
                {"STRM-3", ChannelKind::kScaleFactor, 0, 32, 64},
                {"STRM-3", ChannelKind::kMeanT, 0, 0, 1 << 13},
                {"VAL-1", ChannelKind::kMeanT, 0, 32, (1 << 13) - 1},
                {"RANS-8", ChannelKind::kPosition, 0, 32, end - 1}});
}

// spec: RANS-8, STRM-3, VAL-1, VAL-2, VQ-1, VQ-2
TEST(RansPage, RulesOfCodebooksAndHalfPositions) {
  const SceneHeader h = test::example_header();
  const unsigned temporal = L4D_COMPONENT_ROTOR_TEMPORAL;
  expect_rules(h, h.layers[1],
               {{"VQ-1", ChannelKind::kDepth, L4D_COMPONENT_SH, 0, 4},
                {"VQ-1", ChannelKind::kDepth, L4D_COMPONENT_ROTOR_SPATIAL, 32, kEscapeDepth},
                {"VQ-2", ChannelKind::kIndex, L4D_COMPONENT_SH, 0, 300},
                {"VQ-2", ChannelKind::kIndex, L4D_COMPONENT_SCALE, 32, 41},
                {"VAL-2", ChannelKind::kEscape, temporal, 0, order_half(0x7c00)},
                {"VAL-2", ChannelKind::kEscape, temporal, 1, order_half(0xfe00)},
                {"VAL-1", ChannelKind::kMeanT, 0, 32, order_half(0xfc00)},
                {"RANS-8", ChannelKind::kPosition, 0, 0, uint64_t{1} << 48},
                {"RANS-8", ChannelKind::kPosition, 0, 32, (uint64_t{1} << 63) - 1}});
}

// spec: RANS-8
TEST(RansPage, GapsThatWrapAroundAreOutOfRange) {
  const SceneHeader h = test::example_header();
  Parser parse(kBackends[1]);
  PageColumns columns = rans_columns(h, h.layers[0], nullptr, 4, 3);
  AnyPage page(h, h.layers[0], columns);
  const uint64_t third = (uint64_t{1} << 63) - 1;
  page.put(ChannelKind::kPosition, 0, 0, third);
  page.put(ChannelKind::kPosition, 0, 1, third);
  page.put(ChannelKind::kPosition, 0, 2, 2);  // 2^64 in all
  page.put(ChannelKind::kPosition, 0, 3, 5);
  PageColumns out;
  EXPECT_STREQ(page.decode(parse, &out).clause(), "RANS-8");
}

// Whatever bytes do to a page, what it is taken for is inside the limits that other code relies on.
TEST(RansPage, DamagedBytesAreRefusedOrParsedSafely) {
  Sample sample;
  Random random(3);
  const Page whole = sample.page(true);
  PageColumns out;
  int parsed = 0;
  for (int round = 0; round < 3000; ++round) {
    Page changed = whole;
    for (uint32_t k = 0; k <= random.below(3); ++k) {
      Bytes& part = random.below(2) == 0 ? changed.first : changed.detail;
      part[random.below(static_cast<uint32_t>(part.size()))] ^=
          static_cast<uint8_t>(1u << random.below(8));
    }
    const Status s = sample.parse(changed, sample.header, sample.layer, sample.coded.tables,
                                  nullptr, sample.columns.n, true, &out);
    if (!s.ok()) {
      ASSERT_STRNE(s.clause(), "");
      continue;
    }
    ++parsed;
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      const ComponentCoding& coding = sample.header.component(sample.layer, c);
      for (size_t i = 0; i < sample.columns.n; ++i) {
        ASSERT_LT(out.component[c].step_exponent[i], kTransformStepExponents);
        ASSERT_LE(out.component[c].eob_index[i], coding.eob_table.size());
      }
    }
  }
  EXPECT_GT(parsed, 0);  // a raw bit changes one value and no state
}

}  // namespace
}  // namespace l4d
