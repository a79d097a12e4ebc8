// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/page.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/ordered.h"
#include "tests/common/headers.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using test::Random;

uint16_t random_half(Random& random) {
  const uint16_t bits = static_cast<uint16_t>(random.bits());
  return half_is_finite(bits) ? bits : static_cast<uint16_t>(bits & 0x83ffu);
}

float random_bits(Random& random) {  // any finite pattern, subnormal too
  uint32_t bits = static_cast<uint32_t>(random.bits());
  if ((bits & 0x7f800000u) == 0x7f800000u) bits &= 0x807fffffu;
  float v;
  std::memcpy(&v, &bits, sizeof v);
  return v;
}

// Columns as an encoder would hand them over.
PageColumns random_columns(const SceneHeader& header, const LayerHeader& layer,
                           const BlockRecord* block, size_t n, uint64_t seed) {
  Random random(seed);
  PageColumns c;
  c.n = n;
  const auto mean = [&](CoordinateCodingId coding, std::vector<uint16_t>* half,
                        std::vector<float>* raw) {
    for (size_t i = 0; i < n; ++i) {
      if (coding == CoordinateCodingId::kF16) half->push_back(random_half(random));
      if (coding == CoordinateCodingId::kRaw32) raw->push_back(random_bits(random));
    }
  };
  const auto scalar = [&](const ScalarCoding& coding, std::vector<uint16_t>* codes,
                          std::vector<float>* raw) {
    for (size_t i = 0; i < n; ++i) {
      if (coding.coding == ScalarCodingId::kSq) {
        codes->push_back(static_cast<uint16_t>(random.below(1u << coding.bits)));
      }
      if (coding.coding == ScalarCodingId::kRaw32) raw->push_back(random_bits(random));
    }
  };
  for (size_t k = 0; k < 3; ++k) mean(header.position, &c.position[k], &c.raw_position[k]);
  mean(layer.mean_t, &c.mean_t, &c.raw_mean_t);
  for (size_t i = 0; i < n && layer.mean_t == CoordinateCodingId::kRaw64; ++i) {
    c.raw64_mean_t.push_back(std::ldexp(random.normal(), static_cast<int>(random.below(56))));
  }
  for (size_t i = 0; i < n && layer.mean_t == CoordinateCodingId::kFixed; ++i) {
    c.mean_t.push_back(static_cast<uint16_t>(random.below(1u << layer.mean_t_bits)));
    const unsigned bits = random.below(17);
    if (layer.mean_t_fine) c.mean_t_fine.push_back(static_cast<uint16_t>(random.below(1u << bits)));
  }
  for (size_t k = 0; k < kWindowColumns; ++k) {
    const unsigned width = layer.window_width(k);
    while (width > 0 && c.window[k].size() < n) {
      c.window[k].push_back(static_cast<uint16_t>(random.below(1u << width)));
    }
  }
  scalar(header.opacity, &c.opacity, &c.raw_opacity);
  if (!header.opacity_logit) {
    for (float& v : c.raw_opacity) v = random.uniformf(0, 1);
  }
  scalar(layer.scale_factor, &c.scale_factor, &c.raw_scale_factor);
  for (unsigned comp = 0; comp < L4D_COMPONENT_COUNT; ++comp) {
    const ComponentCoding& coding = header.component(layer, comp);
    const unsigned dim = header.component_dim(layer, comp);
    ComponentColumns& to = c.component[comp];
    if (coding.coding == ComponentCodingId::kRaw32) {
      for (size_t i = 0; i < n * dim; ++i) {
        const bool log_scale = comp == L4D_COMPONENT_SCALE;
        to.raw.push_back(log_scale ? random.uniformf(-17, 17) : random_bits(random));
      }
    }
    if (!coding.vq()) continue;
    for (size_t i = 0; i < n; ++i) {
      uint32_t depth = static_cast<uint32_t>(coding.stages.size());
      if (coding.has_depth()) {
        depth = random.below(depth + 1);
        if (coding.escapes && random.below(5) == 0) depth = kEscapeDepth;
      }
      to.depth.push_back(static_cast<uint8_t>(depth));
      if (depth == kEscapeDepth) {
        for (unsigned k = 0; k < dim; ++k) to.escape.push_back(random_half(random));
        ++to.num_escapes;
        continue;
      }
      for (size_t s = 0; s < depth; ++s) {
        const uint32_t entries =
            s == 0 ? stage0_entries(header, layer, comp, block) : coding.stages[s].num_entries;
        to.index[s].push_back(static_cast<uint16_t>(random.below(entries)));
        ++to.index_count[s];
      }
    }
  }
  return c;
}

template <typename T>
void expect_prefix(const char* what, const std::vector<T>& want, const std::vector<T>& got) {
  ASSERT_GE(got.size(), want.size()) << what;
  if (want.empty()) return;
  ASSERT_EQ(std::memcmp(want.data(), got.data(), want.size() * sizeof(T)), 0) << what;
}

void expect_equal(const SceneHeader& header, const LayerHeader& layer, const PageColumns& a,
                  const PageColumns& b) {
  ASSERT_EQ(a.n, b.n);
  for (size_t k = 0; k < 3; ++k) {
    expect_prefix("position", a.position[k], b.position[k]);
    expect_prefix("raw position", a.raw_position[k], b.raw_position[k]);
  }
  expect_prefix("mean_t", a.mean_t, b.mean_t);
  expect_prefix("mean_t_fine", a.mean_t_fine, b.mean_t_fine);
  for (size_t k = 0; k < kWindowColumns; ++k) expect_prefix("window", a.window[k], b.window[k]);
  expect_prefix("raw64 mean_t", a.raw64_mean_t, b.raw64_mean_t);
  expect_prefix("raw mean_t", a.raw_mean_t, b.raw_mean_t);
  expect_prefix("opacity", a.opacity, b.opacity);
  expect_prefix("raw opacity", a.raw_opacity, b.raw_opacity);
  expect_prefix("factor", a.scale_factor, b.scale_factor);
  expect_prefix("raw factor", a.raw_scale_factor, b.raw_scale_factor);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const ComponentColumns& x = a.component[c];
    const ComponentColumns& y = b.component[c];
    const ComponentCoding& coding = header.component(layer, c);
    expect_prefix("raw", x.raw, y.raw);
    if (!coding.vq()) continue;
    if (coding.has_depth()) expect_prefix("depth", x.depth, y.depth);
    EXPECT_EQ(x.num_escapes, y.num_escapes);
    expect_prefix("escape", x.escape, y.escape);
    for (size_t s = 0; s < coding.stages.size(); ++s) {
      EXPECT_EQ(x.index_count[s], y.index_count[s]);
      expect_prefix("index", x.index[s], y.index[s]);
    }
  }
}

Status parse(ByteSpan raw, const SceneHeader& header, const LayerHeader& layer,
             const BlockRecord* block, size_t n, const PageWants& wants, PageColumns* out,
             SectionBytes* sections = nullptr) {
  StreamDecoder decoder;
  decoder.kernels = &stream_kernels_simd();
  return decode_page(decoder, raw, 5000, header, layer, block, n, wants, out, sections);
}

SceneHeader fixed_times_header() {
  SceneHeader h = test::example_header();
  for (size_t l = 0; l < h.layers.size(); ++l) {
    LayerHeader& layer = h.layers[l];
    if (layer.permanent) continue;
    layer.mean_t = CoordinateCodingId::kFixed;
    layer.mean_t_bits = l % 2 == 0 ? kMaxMeanBits : 5;
    layer.mean_t_fine = l % 2 == 0;
  }
  return h;
}

// Columns of all widths: none, some bits, and beyond 16.
SceneHeader windows_header() {
  SceneHeader h = test::example_header();
  for (LayerHeader& layer : h.layers) {
    if (layer.permanent) continue;
    layer.mean_t = CoordinateCodingId::kWindow;
    layer.window_begin_bits = layer.level == 0 ? kMaxWindowBits : 3;
    layer.window_length_bits = layer.level == 0 ? kMaxWindowBits : 0;
  }
  return h;
}

SceneHeader lossless_header() {
  SceneHeader h = test::example_header();
  h.position = CoordinateCodingId::kRaw32;
  h.opacity.coding = ScalarCodingId::kRaw32;
  h.sh = ComponentCoding();
  h.sh.coding = ComponentCodingId::kRaw32;
  for (LayerHeader& l : h.layers) {
    if (!l.permanent) l.mean_t = CoordinateCodingId::kRaw32;
    l.scale_factor.coding = ScalarCodingId::kRaw32;
    for (ComponentCoding& c : l.component) {
      c = ComponentCoding();
      c.coding = ComponentCodingId::kRaw32;
    }
  }
  return h;
}

SceneHeader double_times_header() {
  SceneHeader h = lossless_header();
  for (LayerHeader& l : h.layers) {
    if (!l.permanent) l.mean_t = CoordinateCodingId::kRaw64;
  }
  return h;
}

SceneHeader plain_header() {  // constants and zeros wherever possible
  SceneHeader h = test::example_header();
  h.opacity = ScalarCoding();
  h.sh = ComponentCoding();
  for (LayerHeader& l : h.layers) {
    l.scale_factor = ScalarCoding();
    for (ComponentCoding& c : l.component) c = ComponentCoding();
  }
  return h;
}

BlockRecord scale_block(uint32_t entries) {
  BlockRecord b;
  b.tables[L4D_COMPONENT_SCALE].num_entries = entries;
  return b;
}

TEST(Page, RoundTripInEveryCoding) {
  StreamEncoder encoder(3);
  const BlockRecord block = scale_block(700);
  uint64_t seed = 0;
  PageColumns
      reused;  // a decoder reuses its buffers, and nothing of one page may leak into the next
  for (const SceneHeader& header :
       {test::example_header(), windows_header(), lossless_header(), plain_header()}) {
    for (const LayerHeader& layer : header.layers) {
      for (const BlockRecord* b : {static_cast<const BlockRecord*>(nullptr), &block}) {
        if (b != nullptr && !layer.component[L4D_COMPONENT_SCALE].has_rcq) continue;
        for (const size_t n : {size_t{1}, size_t{7}, size_t{64}, size_t{1000}, size_t{33}}) {
          const PageColumns columns = random_columns(header, layer, b, n, ++seed);
          const Bytes raw = encode_page(encoder, header, layer, b, columns);
          SectionBytes sections{};
          const Status s = parse(raw, header, layer, b, n, PageWants(), &reused, &sections);
          ASSERT_TRUE(s.ok()) << s.detail();
          expect_equal(header, layer, columns, reused);
          EXPECT_EQ(std::accumulate(sections.begin(), sections.end(), uint64_t{0}), raw.size());
          PageColumns fresh;
          ASSERT_TRUE(parse(raw, header, layer, b, n, PageWants(), &fresh).ok());
          expect_equal(header, layer, columns, fresh);
        }
      }
    }
  }
}

// The bound on the raw bytes of a page holds for what the encoder writes, also in the longest
// codings.
TEST(Page, NoPageIsLongerThanItsBound) {
  StreamEncoder encoder(3);
  SceneHeader longest = test::example_header();
  longest.sh = test::example_vq(65536, 8, true, 1);
  longest.opacity.bits = 16;
  for (LayerHeader& l : longest.layers) {
    l.scale_factor.bits = 16;
    for (ComponentCoding& c : l.component) c = test::example_vq(65536, 8, true, 1);
  }
  for (const SceneHeader& header :
       {test::example_header(), windows_header(), longest, lossless_header()}) {
    for (const LayerHeader& layer : header.layers) {
      for (const size_t n : {size_t{1}, size_t{2}, size_t{100}}) {
        const PageColumns columns = random_columns(header, layer, nullptr, n, n);
        EXPECT_LE(encode_page(encoder, header, layer, nullptr, columns).size(),
                  max_page_bytes(header, n));
      }
    }
  }
}

TEST(Page, LargestPage) {
  StreamEncoder encoder(1);
  const SceneHeader header = test::example_header();
  const size_t n = kMaxPageGaussians;
  const PageColumns columns = random_columns(header, header.layers[1], nullptr, n, 5);
  const Bytes raw = encode_page(encoder, header, header.layers[1], nullptr, columns);
  PageColumns out;
  ASSERT_TRUE(parse(raw, header, header.layers[1], nullptr, n, PageWants(), &out).ok());
  expect_equal(header, header.layers[1], columns, out);
}

// spec: VAL-3
TEST(Page, TimesInDoubleHaveARange) {
  StreamEncoder encoder(3);
  const SceneHeader header = double_times_header();
  const LayerHeader& layer = header.layers.back();
  const double kBad[] = {0x1.1p60, -0x1p1000, std::numeric_limits<double>::infinity(),
                         std::numeric_limits<double>::quiet_NaN()};
  for (const double bad : kBad) {
    PageColumns columns = random_columns(header, layer, nullptr, 50, 7);
    columns.raw64_mean_t[33] = bad;
    const Bytes raw = encode_page(encoder, header, layer, nullptr, columns);
    PageColumns out;
    EXPECT_STREQ(parse(raw, header, layer, nullptr, 50, PageWants(), &out).clause(), "VAL-3");
    PageWants others;
    others.mean_t = false;
    EXPECT_TRUE(parse(raw, header, layer, nullptr, 50, others, &out).ok());
  }
}

TEST(Page, AnySubsetOfAttributesCanBeSkipped) {
  StreamEncoder encoder(3);
  uint64_t seed = 100;
  for (const SceneHeader& header : {test::example_header(), lossless_header(), fixed_times_header(),
                                    double_times_header(), windows_header()}) {
    for (const LayerHeader& layer : header.layers) {
      const size_t n = 50;
      const PageColumns columns = random_columns(header, layer, nullptr, n, ++seed);
      const Bytes raw = encode_page(encoder, header, layer, nullptr, columns);
      for (unsigned mask = 0; mask < 64; ++mask) {
        const auto bit = [&](unsigned i) { return (mask >> i & 1) != 0; };
        const PageWants wants{bit(0), bit(1), bit(2), bit(3), bit(4), bit(5)};
        PageColumns out;
        SectionBytes sections{};
        const Status s = parse(raw, header, layer, nullptr, n, wants, &out, &sections);
        ASSERT_TRUE(s.ok()) << mask << s.detail();
        EXPECT_EQ(std::accumulate(sections.begin(), sections.end(), uint64_t{0}), raw.size());
        if (wants.position) expect_prefix("position", columns.position[2], out.position[2]);
        if (wants.mean_t) expect_prefix("mean_t", columns.mean_t, out.mean_t);
        if (wants.mean_t) expect_prefix("mean_t_fine", columns.mean_t_fine, out.mean_t_fine);
        if (wants.mean_t) expect_prefix("raw64 mean_t", columns.raw64_mean_t, out.raw64_mean_t);
        if (wants.mean_t) expect_prefix("window", columns.window[0], out.window[0]);
        if (wants.opacity) expect_prefix("opacity", columns.opacity, out.opacity);
        if (wants.scale) expect_prefix("factor", columns.scale_factor, out.scale_factor);
        const ComponentColumns& sh = columns.component[L4D_COMPONENT_SH];
        if (wants.sh) {
          expect_prefix("sh", sh.index[1], out.component[L4D_COMPONENT_SH].index[1]);
          expect_prefix("sh", sh.raw, out.component[L4D_COMPONENT_SH].raw);
        }
        const ComponentColumns& rotor = columns.component[L4D_COMPONENT_ROTOR_SPATIAL];
        if (wants.rotor) {
          expect_prefix("rotor", rotor.index[1],
                        out.component[L4D_COMPONENT_ROTOR_SPATIAL].index[1]);
        }
      }
    }
  }
}

// spec: PAGE-1, STRM-2
TEST(Page, TruncatedAtEveryByteAndLongerByOne) {
  StreamEncoder encoder(3);
  uint64_t seed = 200;
  for (const SceneHeader& header :
       {test::example_header(), lossless_header(), fixed_times_header(), double_times_header()}) {
    for (const LayerHeader& layer : header.layers) {
      const size_t n = 30;
      const PageColumns columns = random_columns(header, layer, nullptr, n, ++seed);
      Bytes raw = encode_page(encoder, header, layer, nullptr, columns);
      const PageWants nothing{false, false, false, false, false, false};
      for (const PageWants& wants : {PageWants(), nothing}) {
        PageColumns out;
        for (size_t cut = 0; cut < raw.size(); ++cut) {
          const Bytes shorter(raw.begin(), raw.begin() + static_cast<std::ptrdiff_t>(cut));
          const Status s = parse(shorter, header, layer, nullptr, n, wants, &out);
          ASSERT_EQ(s.code(), L4D_ERR_CORRUPT) << cut;
          ASSERT_STREQ(s.clause(), "STRM-2") << cut << " of " << raw.size();
        }
        Bytes longer = raw;
        longer.push_back(0);
        const Status s = parse(longer, header, layer, nullptr, n, wants, &out);
        EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
        EXPECT_STREQ(s.clause(), "PAGE-1");
        EXPECT_EQ(s.offset(), 5000 + raw.size());
      }
    }
  }
}

TEST(Page, DamagedBytesAreRefusedOrParsedSafely) {
  StreamEncoder encoder(3);
  Random random(77);
  const SceneHeader header = test::example_header();
  for (const LayerHeader& layer : header.layers) {
    const size_t n = 40;
    const PageColumns columns = random_columns(header, layer, nullptr, n, 300);
    const Bytes raw = encode_page(encoder, header, layer, nullptr, columns);
    PageColumns out;
    for (int round = 0; round < 5000; ++round) {
      Bytes damaged = raw;
      damaged[random.below(static_cast<uint32_t>(raw.size()))] =
          static_cast<unsigned char>(random.below(3) == 0 ? random.below(8) : random.below(256));
      const Status s = parse(damaged, header, layer, nullptr, n, PageWants(), &out);
      if (!s.ok()) {
        ASSERT_STRNE(s.clause(), "");
        continue;
      }
      // Whatever is accepted is in range: a decoder indexes with it.
      for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
        const ComponentCoding& coding = header.component(layer, c);
        for (size_t st = 0; st < coding.stages.size(); ++st) {
          for (size_t i = 0; i < out.component[c].index_count[st]; ++i) {
            ASSERT_LT(out.component[c].index[st][i], coding.stages[st].num_entries);
          }
        }
      }
      for (size_t i = 0; i < n; ++i) ASSERT_TRUE(half_is_finite(out.position[0][i]));
    }
  }
}

// What an encoder could only write by mistake.
class PageRules : public testing::Test {
 protected:
  void expect(const char* clause, const PageColumns& columns, const LayerHeader& layer) {
    StreamEncoder encoder(3);
    const Bytes raw = encode_page(encoder, header_, layer, nullptr, columns);
    PageColumns out;
    const Status s = parse(raw, header_, layer, nullptr, columns.n, PageWants(), &out);
    EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
    EXPECT_STREQ(s.clause(), clause) << s.detail();
  }
  PageColumns columns(const LayerHeader& layer, uint64_t seed) const {
    return random_columns(header_, layer, nullptr, 40, seed);
  }
  const LayerHeader& layer() const { return header_.layers[1]; }
  SceneHeader header_ = test::example_header();
};

// spec: VAL-1
TEST_F(PageRules, MeansAreFinite) {
  for (const uint16_t bad : std::vector<uint16_t>{0x7c00, 0xfc00, 0x7fff}) {
    for (size_t axis = 0; axis < 4; ++axis) {
      PageColumns c = columns(layer(), axis);
      (axis < 3 ? c.position[axis] : c.mean_t)[33] = bad;
      expect("VAL-1", c, layer());
    }
  }
}

// spec: VAL-2
TEST_F(PageRules, EscapesAreFinite) {
  PageColumns c = columns(layer(), 9);
  c.component[L4D_COMPONENT_SH].escape.back() = 0x7c00;
  expect("VAL-2", c, layer());
}

// spec: VAL-4
TEST_F(PageRules, RawOpacitiesAndLogScalesAreInRange) {
  header_ = lossless_header();
  header_.opacity_logit = false;
  for (const float bad : {-1e-30f, std::nextafter(1.0f, 2.0f), 1e30f}) {
    PageColumns c = columns(layer(), 21);
    c.raw_opacity.back() = bad;
    expect("VAL-4", c, layer());
  }
  for (const float bad : {std::nextafter(-17.0f, -18.0f), 17.5f, 1e30f}) {
    PageColumns c = columns(layer(), 22);
    c.component[L4D_COMPONENT_SCALE].raw.front() = bad;
    expect("VAL-4", c, layer());
  }
  // Logits may be of any size.
  header_.opacity_logit = true;
  PageColumns c = columns(layer(), 23);
  c.raw_opacity.back() = -1e30f;
  StreamEncoder encoder(3);
  const Bytes raw = encode_page(encoder, header_, layer(), nullptr, c);
  PageColumns out;
  EXPECT_TRUE(parse(raw, header_, layer(), nullptr, c.n, PageWants(), &out).ok());
}

// spec: VAL-3
TEST_F(PageRules, RawValuesAreFinite) {
  header_ = lossless_header();
  for (const float bad :
       {std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity(),
        std::numeric_limits<float>::quiet_NaN()}) {
    for (int array = 0; array < 5; ++array) {
      PageColumns c = columns(layer(), 20);
      std::vector<float>* const kArrays[] = {&c.raw_position[1], &c.raw_mean_t, &c.raw_opacity,
                                             &c.raw_scale_factor,
                                             &c.component[L4D_COMPONENT_SH].raw};
      if (kArrays[array]->empty()) continue;  // not an array of this layer
      kArrays[array]->back() = bad;
      expect("VAL-3", c, layer());
    }
  }
}

// spec: VQ-1
TEST_F(PageRules, DepthsAreKnown) {
  PageColumns c = columns(layer(), 10);
  c.component[L4D_COMPONENT_SH].depth[0] = 4;  // of 3 stages
  expect("VQ-1", c, layer());
  c = columns(layer(), 11);
  c.component[L4D_COMPONENT_ROTOR_SPATIAL].depth[5] = kEscapeDepth;  // which has no escapes
  expect("VQ-1", c, layer());
}

// spec: VQ-2
TEST_F(PageRules, IndicesAreInTheirCodebooks) {
  for (size_t stage = 0; stage < 3; ++stage) {
    PageColumns c = columns(layer(), 12 + stage);
    const uint32_t entries = header_.sh.stages[stage].num_entries;
    c.component[L4D_COMPONENT_SH].index[stage].back() = static_cast<uint16_t>(entries);
    expect("VQ-2", c, layer());
  }
}

}  // namespace
}  // namespace l4d
