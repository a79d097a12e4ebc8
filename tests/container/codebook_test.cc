// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/quant/codebook.h"

#include <gtest/gtest.h>

#include <cstring>

#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/ordered.h"
#include "tests/common/random.h"
#include "tests/common/stream_writer.h"

namespace l4d {
namespace {

std::vector<float> random_halves(size_t n, uint64_t seed) {
  test::Random random(seed);
  std::vector<float> v(n);
  for (float& x : v) {
    uint16_t bits = static_cast<uint16_t>(random.bits());
    if (!half_is_finite(bits)) bits = static_cast<uint16_t>(bits & 0xbfffu);
    x = half_to_float(bits);
  }
  return v;
}

StageCoding half_stage(uint32_t entries) {
  StageCoding stage;
  stage.num_entries = entries;
  return stage;
}

Status decode(ByteSpan bytes, uint32_t entries, uint32_t dim, CodebookData* out) {
  StreamDecoder decoder;
  decoder.kernels = &stream_kernels_simd();
  const StageCoding stage = half_stage(entries);
  return decode_codebook(decoder, bytes, 500, stage, dim, out);
}

TEST(OrderedHalf, OrderIsNumericForAllFiniteHalves) {
  uint16_t previous = 0;
  bool first = true;
  for (uint32_t ordered = 0; ordered < 65536; ++ordered) {
    const uint16_t bits = unorder_half(static_cast<uint16_t>(ordered));
    ASSERT_EQ(order_half(bits), ordered);
    if (!half_is_finite(bits)) continue;
    if (!first) {
      const float a = half_to_float(previous), b = half_to_float(bits);
      ASSERT_LE(a, b) << ordered;
      if (a == b) {  // -0 and +0, in this order
        ASSERT_EQ(previous, 0x8000);
        ASSERT_EQ(bits, 0);
      }
    }
    previous = bits;
    first = false;
  }
}

TEST(OrderedFloat, RoundTripAndOrder) {
  test::Random random(8);
  for (int i = 0; i < 100000; ++i) {
    const uint32_t x = static_cast<uint32_t>(random.bits());
    const uint32_t y = static_cast<uint32_t>(random.bits());
    float fx, fy;
    std::memcpy(&fx, &x, sizeof fx);
    std::memcpy(&fy, &y, sizeof fy);
    const uint32_t ox = order_float(fx);
    const float back = unorder_float(ox);
    ASSERT_EQ(std::memcmp(&back, &x, sizeof back), 0);
    if (fx < fy) {
      ASSERT_LT(ox, order_float(fy));
    }
  }
}

TEST(Codebook, RoundTrip) {
  StreamEncoder encoder(3);
  for (const uint32_t dim : {1u, 3u, 4u, 12u, 27u, 48u}) {
    for (const uint32_t entries : {1u, 2u, 33u, 4096u}) {
      if (entries == 4096 && dim > 4) continue;
      const auto values = random_halves(size_t{entries} * dim, entries * 100 + dim);
      const Bytes bytes = encode_codebook(encoder, half_stage(entries), values.data(), dim);
      CodebookData codebook;
      const Status s = decode(bytes, entries, dim, &codebook);
      ASSERT_TRUE(s.ok()) << s.detail();
      EXPECT_EQ(codebook.num_entries, entries);
      EXPECT_EQ(codebook.dim, dim);
      ASSERT_EQ(codebook.entries.size(), values.size() + CodebookData::kPadding);
      EXPECT_EQ(std::memcmp(codebook.entries.data(), values.data(), values.size() * sizeof(float)),
                0);
      for (size_t i = values.size(); i < codebook.entries.size(); ++i)
        EXPECT_EQ(codebook.entries[i], 0.0f);
    }
  }
}

// Every 16-bit integer, as a multiple of a step.
TEST(Codebook, MultiplesOfAStepRoundTrip) {
  StreamEncoder encoder(3);
  for (const float step : {0x1p-20f, 0.37f, 1024.0f}) {
    StageCoding stage = half_stage(65536);
    stage.element = ElementType::kSq;
    stage.step = step;
    std::vector<float> values;
    for (int q = -32768; q < 32768; ++q) values.push_back(step * static_cast<float>(q));
    const Bytes bytes = encode_codebook(encoder, stage, values.data(), 1);
    StreamDecoder decoder;
    decoder.kernels = &stream_kernels_simd();
    CodebookData codebook;
    const Status s = decode_codebook(decoder, bytes, 500, stage, 1, &codebook);
    ASSERT_TRUE(s.ok()) << s.detail();
    EXPECT_EQ(std::memcmp(codebook.entries.data(), values.data(), values.size() * sizeof(float)),
              0);
  }
}

// spec: STRM-2, CHNK-7
TEST(Codebook, TruncatedAndLeftOver) {
  StreamEncoder encoder(3);
  const auto values = random_halves(40 * 4, 3);
  Bytes bytes = encode_codebook(encoder, half_stage(40), values.data(), 4);
  CodebookData codebook;
  for (size_t n = 0; n < bytes.size(); ++n) {
    const Bytes cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n));
    const Status s = decode(cut, 40, 4, &codebook);
    ASSERT_EQ(s.code(), L4D_ERR_CORRUPT) << n;
    ASSERT_STREQ(s.clause(), "STRM-2") << n;
  }
  bytes.push_back(0);
  const Status s = decode(bytes, 40, 4, &codebook);
  EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
  EXPECT_STREQ(s.clause(), "CHNK-7");
}

// spec: CODE-4
TEST(Codebook, NonFiniteValuesAreRefused) {
  for (const uint16_t bits : std::vector<uint16_t>{0x7c00, 0xfc00, 0x7e00, 0xffff, 0x7c01}) {
    for (const size_t at : {size_t{0}, size_t{17}, size_t{39}}) {
      std::vector<uint16_t> column(40, order_half(0x3c00));
      column[at] = order_half(bits);
      CodebookData codebook;
      const Status s = decode(test::packed_stream(column, 16), 40, 1, &codebook);
      EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
      EXPECT_STREQ(s.clause(), "CODE-4") << std::hex << bits;
    }
  }
}

struct RcqCodebooks {
  CodebookData global, residual;
};

RcqCodebooks rcq_codebooks(uint32_t num_global, uint32_t num_residual, uint32_t dim) {
  StreamEncoder encoder(3);
  RcqCodebooks b;
  const auto g = random_halves(size_t{num_global} * dim, 1);
  const auto r = random_halves(size_t{num_residual} * dim, 2);
  EXPECT_TRUE(decode(encode_codebook(encoder, half_stage(num_global), g.data(), dim), num_global,
                     dim, &b.global)
                  .ok());
  EXPECT_TRUE(decode(encode_codebook(encoder, half_stage(num_residual), r.data(), dim),
                     num_residual, dim, &b.residual)
                  .ok());
  return b;
}

Status decode_table(ByteSpan bytes, uint32_t entries, const RcqCodebooks& codebooks,
                    CodebookData* out) {
  StreamDecoder decoder;
  decoder.kernels = &stream_kernels_simd();
  return decode_rcq_table(decoder, bytes, 500, entries, codebooks.global, codebooks.residual, out);
}

TEST(RcqTable, RoundTripSumsRows) {
  test::Random random(6);
  StreamEncoder encoder(3);
  for (const auto& [num_global, num_residual] :
       {std::pair<uint32_t, uint32_t>{300, 17}, {1, 1}, {4096, 4096}, {2, 1}}) {
    const RcqCodebooks codebooks = rcq_codebooks(num_global, num_residual, 4);
    for (const size_t entries : {size_t{1}, size_t{5}, size_t{1000}}) {
      std::vector<RcqPair> pairs(entries);
      for (RcqPair& p : pairs) {
        p.global = static_cast<uint16_t>(random.below(num_global));
        p.residual = static_cast<uint16_t>(random.below(num_residual));
      }
      const Bytes bytes = encode_rcq_table(encoder, pairs, num_global, num_residual);
      CodebookData out;
      const Status s = decode_table(bytes, static_cast<uint32_t>(entries), codebooks, &out);
      ASSERT_TRUE(s.ok()) << s.detail();
      ASSERT_EQ(out.num_entries, entries);
      for (size_t i = 0; i < entries; ++i) {
        for (size_t k = 0; k < 4; ++k) {
          const float sum = codebooks.global.row(pairs[i].global)[k] +
                            codebooks.residual.row(pairs[i].residual)[k];
          ASSERT_EQ(std::memcmp(&out.row(i)[k], &sum, sizeof sum), 0);
        }
      }
    }
  }
}

// spec: RCQ-1
TEST(RcqTable, IndicesBeyondTheCodebooksAreRefused) {
  const RcqCodebooks codebooks = rcq_codebooks(300, 17, 4);
  StreamEncoder encoder(3);
  for (const RcqPair bad : {RcqPair{300, 0}, RcqPair{511, 0}, RcqPair{0, 17}, RcqPair{0, 31}}) {
    std::vector<RcqPair> pairs = {{1, 2}, {3, 4}, bad, {5, 6}};
    CodebookData out;
    const Status s = decode_table(encode_rcq_table(encoder, pairs, 300, 17), 4, codebooks, &out);
    EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
    EXPECT_STREQ(s.clause(), "RCQ-1");
  }
}

// spec: STRM-2, CHNK-7
TEST(RcqTable, TruncatedAndLeftOver) {
  const RcqCodebooks codebooks = rcq_codebooks(300, 17, 4);
  StreamEncoder encoder(3);
  const std::vector<RcqPair> pairs = {{1, 2}, {3, 4}, {299, 16}, {5, 6}};
  Bytes bytes = encode_rcq_table(encoder, pairs, 300, 17);
  CodebookData out;
  for (size_t n = 0; n < bytes.size(); ++n) {
    const Bytes cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n));
    ASSERT_STREQ(decode_table(cut, 4, codebooks, &out).clause(), "STRM-2") << n;
  }
  bytes.push_back(7);
  EXPECT_STREQ(decode_table(bytes, 4, codebooks, &out).clause(), "CHNK-7");
}

}  // namespace
}  // namespace l4d
