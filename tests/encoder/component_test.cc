// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numeric>
#include <set>

#include "decoder/expand/reconstruct.h"
#include "encoder/component/codebook_coder.h"
#include "libl4dcodec/base/half.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using test::Random;

struct Data {
  size_t n, dim;
  std::vector<float> rows, weights;
};

// Points about `centers` random places.
Data clustered(size_t n, size_t dim, size_t centers, uint64_t seed, double spread = 0.05) {
  Random random(seed);
  std::vector<double> places(centers * dim);
  for (double& p : places) p = random.normal();
  Data d{n, dim, {}, {}};
  for (size_t i = 0; i < n; ++i) {
    const size_t c = random.below(static_cast<uint32_t>(centers));
    for (size_t k = 0; k < dim; ++k) {
      d.rows.push_back(static_cast<float>(places[c * dim + k] + spread * random.normal()));
    }
    d.weights.push_back(random.uniformf(0.1, 2));
  }
  return d;
}

ComponentSettings small_settings() {
  ComponentSettings s;
  s.codebook_size = 32;
  s.iterations = 5;
  s.threads = 1;
  return s;
}

CodedVq code(const Data& d, const ComponentSettings& s,
             const std::vector<BlockRange>& blocks = {}) {
  return code_vq(d.rows.data(), d.weights.data(), d.n, d.dim, blocks, s);
}

// Rows as a decoder makes them from what is coded: codebooks, tables, indices and escapes of the
// input.
std::vector<float> reconstruct(const CodedVq& c, const Data& d,
                               const std::vector<BlockRange>& blocks = {}) {
  std::vector<float> out(c.n * c.dim);
  const auto run = [&](size_t begin, size_t end, const std::vector<float>& codebook0) {
    VqSource source;
    source.dim = c.dim;
    source.num_stages = c.codebooks.size();
    std::vector<std::vector<uint16_t>> compact(c.codebooks.size());
    std::vector<uint16_t> escape;
    std::vector<std::vector<float>> codebooks = c.codebooks;
    codebooks[0] = codebook0;
    for (size_t i = begin; i < end; ++i) {
      if (c.depth[i] == kEscapeDepth) {
        for (size_t k = 0; k < c.dim; ++k) escape.push_back(float_to_half(d.rows[i * c.dim + k]));
        continue;
      }
      for (size_t s = 0; s < c.depth[i]; ++s) compact[s].push_back(c.index[s][i]);
    }
    for (size_t s = 0; s < codebooks.size(); ++s) {
      codebooks[s].resize(codebooks[s].size() + CodebookData::kPadding);
      source.codebook[s] = codebooks[s].data();
      source.index[s] = compact[s].data();
    }
    source.depth = c.depth.data() + begin;
    source.escape = escape.data();
    VqCursor cursor;
    reconstruct_kernels_simd().vq_rows(source, cursor, 0, end - begin, out.data() + begin * c.dim,
                                       false);
  };
  if (c.block_tables.empty()) {
    run(0, c.n, c.codebooks[0]);
    return out;
  }
  for (size_t b = 0; b < blocks.size(); ++b) {
    std::vector<float> codebook = c.codebooks[0];
    if (!c.block_tables[b].empty()) {
      codebook.clear();
      for (const RcqPair& p : c.block_tables[b]) {
        for (size_t k = 0; k < c.dim; ++k) {
          codebook.push_back(c.codebooks[0][p.global * c.dim + k] +
                             c.residual_codebook[p.residual * c.dim + k]);
        }
      }
    }
    run(blocks[b].begin, blocks[b].end, codebook);
  }
  return out;
}

void expect_same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  ASSERT_EQ(a.size(), b.size());
  ASSERT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)), 0);
}

double distortion(const CodedVq& c, const Data& d) {
  double sum = 0;
  for (size_t i = 0; i < d.n; ++i) {
    double e2 = 0;
    for (size_t k = 0; k < d.dim; ++k) {
      const double e = static_cast<double>(d.rows[i * d.dim + k]) -
                       static_cast<double>(c.decoded[i * d.dim + k]);
      e2 += e * e;
    }
    sum += static_cast<double>(d.weights[i]) * e2;
  }
  return sum;
}

TEST(Component, CodebooksHoldHalves) {
  const Data d = clustered(2000, 4, 20, 1);
  ComponentSettings s = small_settings();
  s.stages = {1, 0.5f};
  for (const auto& codebook : code(d, s).codebooks) {
    EXPECT_LE(codebook.size(), 32u * 4);
    for (const float v : codebook) EXPECT_EQ(v, half_to_float(float_to_half(v)));
  }
}

TEST(Component, DecodedRowsAreTheDecoders) {
  for (const size_t dim : {size_t{3}, size_t{4}, size_t{12}, size_t{48}}) {
    const Data d = clustered(1500, dim, 20, dim);
    ComponentSettings s = small_settings();
    s.stages = {1, 0.6f, 0.3f, 0.1f};
    s.escape_threshold = 1.9;
    CodedVq c = code(d, s);
    expect_same_bits(c.decoded, reconstruct(c, d));
    const std::vector<float> before = c.decoded;
    sort_codebooks_by_frequency(c, {});
    expect_same_bits(before, reconstruct(c, d));
    expect_same_bits(before, c.decoded);
  }
}

TEST(Component, StageFractionsAreHonoured) {
  const Data d = clustered(2000, 4, 50, 3);
  ComponentSettings s = small_settings();
  s.stages = {1, 0.5f, 0.25f, 0.1f};
  const CodedVq c = code(d, s);
  ASSERT_EQ(c.codebooks.size(), 4u);
  for (size_t stage = 0; stage < 4; ++stage) {
    const auto deeper =
        std::count_if(c.depth.begin(), c.depth.end(), [&](uint8_t depth) { return depth > stage; });
    EXPECT_EQ(static_cast<double>(deeper), std::round(2000 * static_cast<double>(s.stages[stage])));
  }
}

TEST(Component, StagesGoToTheLargestErrors) {
  const Data d = clustered(2000, 4, 50, 4);
  ComponentSettings one = small_settings();
  ComponentSettings two = one;
  two.stages = {1, 0.3f};
  const CodedVq c1 = code(d, one);
  const CodedVq c2 = code(d, two);
  float min_chosen = 1e30f, most_left = 0;
  for (size_t i = 0; i < d.n; ++i) {
    double e2 = 0;
    for (size_t k = 0; k < d.dim; ++k) {
      const double e =
          static_cast<double>(d.rows[4 * i + k]) - static_cast<double>(c1.decoded[4 * i + k]);
      e2 += e * e;
    }
    const float need = static_cast<float>(static_cast<double>(d.weights[i]) * e2);
    if (c2.depth[i] > 1) {
      min_chosen = std::min(min_chosen, need);
    } else {
      most_left = std::max(most_left, need);
    }
  }
  EXPECT_GE(min_chosen, most_left);
}

TEST(Component, EachStageReducesTheError) {
  const Data d = clustered(3000, 12, 200, 5, 0.2);
  double previous = 1e30;
  for (size_t stages = 1; stages <= 4; ++stages) {
    ComponentSettings s = small_settings();
    s.stages.assign(stages, 1.0f);
    const CodedVq c = code(d, s);
    EXPECT_NEAR(c.weighted_distortion, distortion(c, d), 1e-6 * c.weighted_distortion);
    EXPECT_LT(c.weighted_distortion, previous);
    previous = c.weighted_distortion;
  }
}

TEST(Component, MoreWeightMeansLessError) {
  Data d = clustered(3000, 4, 300, 6, 0.3);
  for (size_t i = 0; i < d.n; ++i) d.weights[i] = i % 2 == 0 ? 100.0f : 0.01f;
  ComponentSettings s = small_settings();
  s.sample_per_codeword = 1000;
  const CodedVq c = code(d, s);
  double error[2] = {0, 0};
  for (size_t i = 0; i < d.n; ++i) {
    for (size_t k = 0; k < 4; ++k) {
      const double e =
          static_cast<double>(d.rows[4 * i + k]) - static_cast<double>(c.decoded[4 * i + k]);
      error[i % 2] += e * e;
    }
  }
  EXPECT_LT(error[0], error[1]);
}

TEST(Component, EscapesAreThoseAboveTheThreshold) {
  const Data d = clustered(1000, 4, 20, 7);
  ComponentSettings s = small_settings();
  s.stages = {1, 0.5f};
  s.escape_threshold = 1.5;
  const CodedVq c = code(d, s);
  EXPECT_TRUE(c.any_escape);
  for (size_t i = 0; i < d.n; ++i) {
    EXPECT_EQ(c.depth[i] == kEscapeDepth, static_cast<double>(d.weights[i]) > 1.5) << i;
    if (c.depth[i] != kEscapeDepth) continue;
    for (size_t k = 0; k < 4; ++k) {
      EXPECT_EQ(c.decoded[4 * i + k], half_to_float(float_to_half(d.rows[4 * i + k])));
    }
  }
  s.escape_threshold = 100;
  EXPECT_FALSE(code(d, s).any_escape);
}

TEST(Component, AllEscapes) {
  const Data d = clustered(50, 4, 5, 8);
  ComponentSettings s = small_settings();
  s.stages = {1, 0.5f};
  s.escape_threshold = 1e-9;
  CodedVq c = code(d, s);
  sort_codebooks_by_frequency(c, {});
  ComponentCoding coding;
  describe_component(c, &coding);
  EXPECT_EQ(coding.coding, ComponentCodingId::kVq);
  EXPECT_TRUE(coding.escapes);
  ASSERT_GE(coding.stages.size(), 1u);
  EXPECT_EQ(coding.stages[0].num_entries, 1u);
  expect_same_bits(c.decoded, reconstruct(c, d));
}

TEST(Component, CodesOfSomeGaussiansInAnotherOrder) {
  const Data d = clustered(400, 4, 40, 21);
  ComponentSettings s = small_settings();
  s.stages = {1, 0.5f};
  s.escape_threshold = 1.5;
  CodedVq c = code(d, s);
  ASSERT_TRUE(c.any_escape);
  const std::vector<uint32_t> which = {399, 7, 0, 250, 8, 31};
  for (const int threads : {1, 3}) {
    const CodedVq codes = std::get<CodedVq>(codes_of(c, which, threads));
    EXPECT_EQ(codes.n, which.size());
    EXPECT_TRUE(codes.codebooks.empty());
    ASSERT_EQ(codes.index.size(), c.index.size());
    for (size_t j = 0; j < which.size(); ++j) {
      const size_t i = which[j];
      EXPECT_EQ(codes.depth[j], c.depth[i]);
      for (size_t k = 0; k < c.index.size(); ++k) EXPECT_EQ(codes.index[k][j], c.index[k][i]);
      for (size_t k = 0; k < 4; ++k) {
        EXPECT_EQ(codes.decoded[4 * j + k], c.decoded[4 * i + k]);
      }
    }
  }
  CodedComponent dropped = c;
  drop_codes(dropped);
  EXPECT_FALSE(std::get<CodedVq>(dropped).codebooks.empty());
  EXPECT_TRUE(std::get<CodedVq>(dropped).depth.empty());
  EXPECT_TRUE(rows_of(dropped).decoded.empty());
}

TEST(Component, CodesOfATransformInAnotherOrder) {
  const Data d = clustered(300, 12, 10, 22, 0.5);
  TransformSettings s;
  s.distortion = 1e-3;
  s.max_step = 1;
  s.principal_axes = true;
  s.threads = 1;
  const CodedTransform c = code_transform(d.rows.data(), d.weights.data(), d.n, d.dim, s);
  ASSERT_FALSE(c.coefficient.empty());
  const std::vector<uint32_t> which = {299, 3, 120};
  const CodedTransform codes = std::get<CodedTransform>(codes_of(c, which, 1));
  EXPECT_TRUE(codes.decoded.empty());  // nothing of it is stored
  ASSERT_EQ(codes.coefficient.size(), c.coefficient.size());
  for (size_t j = 0; j < which.size(); ++j) {
    const size_t i = which[j];
    EXPECT_EQ(codes.step_exponent[j], c.step_exponent[i]);
    EXPECT_EQ(codes.eob_index[j], c.eob_index[i]);
    for (size_t k = 0; k < c.coefficient.size(); ++k) {
      EXPECT_EQ(codes.coefficient[k][j], c.coefficient[k][i]);
    }
  }
}

TEST(Component, EscapesSaturateInsteadOfOverflowing) {
  Data d = clustered(10, 4, 2, 9);
  d.rows[5] = 1e9f;
  d.rows[6] = -1e9f;
  ComponentSettings s = small_settings();
  s.escape_threshold = 1e-9;
  const CodedVq c = code(d, s);
  EXPECT_EQ(c.decoded[5], 65504.0f);
  EXPECT_EQ(c.decoded[6], -65504.0f);
}

TEST(Component, DegenerateInput) {
  for (const size_t n : {size_t{1}, size_t{2}, size_t{3}, size_t{100}}) {
    for (const float weight : {0.0f, 1.0f, 1e-30f, 1e30f}) {
      Data d{n, 4, std::vector<float>(4 * n, 0.25f), std::vector<float>(n, weight)};
      ComponentSettings s = small_settings();
      s.stages = {1, 1, 0.5f};
      CodedVq c = code(d, s);
      sort_codebooks_by_frequency(c, {});
      for (const float v : c.decoded) EXPECT_EQ(v, 0.25f);
      expect_same_bits(c.decoded, reconstruct(c, d));
    }
  }
}

TEST(Component, RankingPutsFrequentEntriesFirstAndDropsUnusedOnes) {
  const Data d = clustered(4000, 4, 10, 10);
  CodedVq c = code(d, small_settings());
  sort_codebooks_by_frequency(c, {});
  std::vector<size_t> use(c.codebooks[0].size() / 4, 0);
  for (const uint16_t i : c.index[0]) ++use.at(i);
  EXPECT_TRUE(std::is_sorted(use.rbegin(), use.rend()));
  EXPECT_GT(use.back(), 0u);
}

TEST(Component, DroppedGaussiansLeaveTheRestAsItWas) {
  const Data d = clustered(500, 4, 10, 11);
  ComponentSettings s = small_settings();
  s.stages = {1, 0.5f};
  s.escape_threshold = 1.8;
  const CodedVq whole = code(d, s);
  CodedComponent component = whole;
  std::vector<uint8_t> keep(d.n);
  Data kept{0, 4, {}, {}};
  std::vector<float> want;
  for (size_t i = 0; i < d.n; ++i) {
    keep[i] = i % 3 != 1;
    if (!keep[i]) continue;
    ++kept.n;
    for (size_t k = 0; k < 4; ++k) {
      kept.rows.push_back(d.rows[4 * i + k]);
      want.push_back(whole.decoded[4 * i + k]);
    }
    kept.weights.push_back(d.weights[i]);
  }
  drop_gaussians(component, keep);
  CodedVq& c = std::get<CodedVq>(component);
  ASSERT_EQ(c.n, kept.n);
  sort_codebooks_by_frequency(c, {});
  expect_same_bits(want, c.decoded);
  expect_same_bits(want, reconstruct(c, kept));
}

TEST(Component, EqualForAnyNumberOfThreadsAndUnequalForOtherSeeds) {
  const Data d = clustered(20000, 4, 300, 12, 0.3);
  ComponentSettings s = small_settings();
  s.stages = {1, 0.5f};
  const CodedVq one = code(d, s);
  for (const int threads : {2, 7}) {
    s.threads = threads;
    const CodedVq c = code(d, s);
    EXPECT_EQ(c.codebooks, one.codebooks);
    EXPECT_EQ(c.index, one.index);
    EXPECT_EQ(c.depth, one.depth);
  }
  s.seed = 1;
  EXPECT_NE(code(d, s).codebooks, one.codebooks);
}

// ---- RCQ ---------------------------------------------------------------------------------------

// Blocks of n points each, with places of their own or with common ones.
Data block_data(size_t num_blocks, size_t n, bool own_places, std::vector<BlockRange>* blocks) {
  Data all{0, 4, {}, {}};
  for (size_t b = 0; b < num_blocks; ++b) {
    const Data d = own_places ? clustered(n, 4, 24, 100 + b, 0.01) : clustered(n, 4, 24, 100, 0.01);
    blocks->push_back({all.n, all.n + n});
    all.n += n;
    all.rows.insert(all.rows.end(), d.rows.begin(), d.rows.end());
    all.weights.insert(all.weights.end(), d.weights.begin(), d.weights.end());
  }
  return all;
}

ComponentSettings rcq_settings(int rcq) {
  ComponentSettings s = small_settings();
  s.codebook_size = 64;
  s.rcq = rcq;
  s.rcq_size = 64;
  return s;
}

TEST(Rcq, PaysWhereBlocksDiffer) {
  std::vector<BlockRange> blocks;
  const Data d = block_data(8, 3000, true, &blocks);
  const CodedVq plain = code(d, rcq_settings(0), blocks);
  CodedVq c = code(d, rcq_settings(1), blocks);
  EXPECT_TRUE(plain.block_tables.empty());
  ASSERT_EQ(c.block_tables.size(), blocks.size());
  ASSERT_FALSE(c.residual_codebook.empty());
  EXPECT_LE(c.residual_codebook.size() / 4, 64u);
  const auto used = std::count_if(c.block_tables.begin(), c.block_tables.end(),
                                  [](const auto& t) { return !t.empty(); });
  EXPECT_GE(used, 4);
  EXPECT_LT(c.weighted_distortion, 0.7 * plain.weighted_distortion);
  expect_same_bits(c.decoded, reconstruct(c, d, blocks));
  const std::vector<float> before = c.decoded;
  sort_codebooks_by_frequency(c, blocks);
  expect_same_bits(before, reconstruct(c, d, blocks));
  for (const float v : c.residual_codebook) EXPECT_EQ(v, half_to_float(float_to_half(v)));
}

TEST(Rcq, DoesNotPayOnUniformData) {
  std::vector<BlockRange> blocks;
  const Data d = block_data(8, 1500, false, &blocks);
  const CodedVq plain = code(d, rcq_settings(0), blocks);
  const CodedVq c = code(d, rcq_settings(1), blocks);
  EXPECT_TRUE(c.block_tables.empty());
  EXPECT_TRUE(c.residual_codebook.empty());
  EXPECT_EQ(c.codebooks, plain.codebooks);
  EXPECT_EQ(c.index, plain.index);
}

TEST(Rcq, AlwaysUsesEveryBlock) {
  for (const bool own_places : {true, false}) {
    std::vector<BlockRange> blocks;
    const Data d = block_data(4, 1000, own_places, &blocks);
    ComponentSettings s = rcq_settings(2);
    s.stages = {1, 0.3f};
    CodedVq c = code(d, s, blocks);
    ASSERT_EQ(c.block_tables.size(), blocks.size());
    for (const auto& t : c.block_tables) EXPECT_FALSE(t.empty());
    expect_same_bits(c.decoded, reconstruct(c, d, blocks));
    const std::vector<float> before = c.decoded;
    sort_codebooks_by_frequency(c, blocks);
    expect_same_bits(before, reconstruct(c, d, blocks));
    for (size_t b = 0; b < blocks.size(); ++b) {
      for (size_t i = blocks[b].begin; i < blocks[b].end; ++i) {
        ASSERT_LT(c.index[0][i], c.block_tables[b].size());
      }
    }
  }
}

// Escapes have no index: a block is coded as if they were not there, one of escapes alone not at
// all.
TEST(Rcq, EscapesMeetBlocks) {
  std::vector<BlockRange> blocks;
  Data d = block_data(4, 1000, true, &blocks);
  for (size_t i = blocks[2].begin; i < blocks[2].end; ++i) d.weights[i] = 9;
  ComponentSettings s = rcq_settings(2);
  s.escape_threshold = 1.5;
  s.stages = {1, 0.3f};
  CodedVq c = code(d, s, blocks);
  EXPECT_TRUE(c.any_escape);
  ASSERT_EQ(c.block_tables.size(), blocks.size());
  ASSERT_FALSE(c.residual_codebook.empty());
  for (size_t b = 0; b < blocks.size(); ++b) EXPECT_EQ(c.block_tables[b].empty(), b == 2) << b;
  expect_same_bits(c.decoded, reconstruct(c, d, blocks));
  const std::vector<float> before = c.decoded;
  sort_codebooks_by_frequency(c, blocks);
  expect_same_bits(before, reconstruct(c, d, blocks));
}

}  // namespace
}  // namespace l4d
