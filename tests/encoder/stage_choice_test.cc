// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/stage_choice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "encoder/component/codebook_coder.h"
#include "encoder/component/coding_cost.h"
#include "encoder/search/kmeans.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using test::Random;

// Rows whose numbers fall off from first to last, as those of attributes do.
struct Rows {
  size_t n, dim;
  std::vector<float> values, weights;
};
Rows make_rows(size_t n, size_t dim, uint64_t seed) {
  Random random(seed);
  Rows rows{n, dim, {}, {}};
  for (size_t i = 0; i < n; ++i) {
    for (size_t k = 0; k < dim; ++k) {
      rows.values.push_back(static_cast<float>(random.normal() / static_cast<double>(k + 1)));
    }
    rows.weights.push_back(static_cast<float>(std::exp(2 * random.normal())));
  }
  return rows;
}

ComponentSettings by_cost(double rd_lambda) {
  ComponentSettings s;
  s.codebook_size = 1024;
  s.iterations = 6;
  s.threads = 1;
  s.rd_lambda = rd_lambda;
  return s;
}

double cost(const CodedVq& c, double rd_lambda) {
  return component_bits(c) + c.weighted_distortion / rd_lambda;
}

TEST(StageChoice, EffectiveDimensionIsThatOfUniformVectors) {
  // A uniform quantiser of d numbers has an error that falls as k^(-2 / d), whatever the d.
  for (const double d : {1.0, 3.0, 4.0, 48.0}) {
    for (const double k : {16.0, 4096.0}) {
      EXPECT_NEAR(effective_dimension(1, std::pow(k, -2 / d), k), d, 1e-9 * d);
      EXPECT_NEAR(error_after_stage(k, d), std::pow(k, -2 / d), 1e-12);
    }
  }
  EXPECT_EQ(effective_dimension(0, 0, 64), 1);
  EXPECT_EQ(effective_dimension(1, 2, 64), 1);
}

TEST(StageChoice, CodewordsAreThoseOfLeastCost) {
  for (const double price : {1e-6, 1e-4, 1e-2}) {
    const double error = 1000, dim = 4;
    const size_t n = 100000;
    const auto total = [&](double k) {
      return error * std::pow(k, -2 / dim) +
             price * (static_cast<double>(n) * std::log2(k) + codebook_bits(k, 4));
    };
    double least = total(16);
    uint32_t best = 16;
    for (uint32_t k = 32; k <= 65536; k *= 2) {
      if (total(k) >= least) continue;
      least = total(k);
      best = k;
    }
    EXPECT_EQ(codewords_by_cost(error, n, 4, dim, price, 65536), best) << price;
  }
  EXPECT_EQ(codewords_by_cost(1000, 100, 4, 4, 1e-9, 8), 8u);
}

TEST(StageChoice, StagesGoToThoseWhomTheyAreWorth) {
  Random random(5);
  std::vector<uint32_t> members(20000);
  std::iota(members.begin(), members.end(), 0u);
  std::vector<float> error(members.size());
  for (float& e : error) e = static_cast<float>(std::exp(3 * random.normal()));
  const StageChoice choice = choose_stage(members, error, 4, 4, 0.05, 4096);
  ASSERT_FALSE(choice.members.empty());
  ASSERT_LT(choice.members.size(), members.size());
  std::vector<uint8_t> chosen(error.size(), 0);
  for (const uint32_t i : choice.members) chosen[i] = 1;
  float min_in = 1e30f, most_out = 0;
  for (size_t i = 0; i < error.size(); ++i) {
    (chosen[i] ? min_in : most_out) =
        chosen[i] ? std::min(min_in, error[i]) : std::max(most_out, error[i]);
  }
  EXPECT_GT(min_in, most_out);
  // Nothing is worth a bit that costs more than all errors together.
  EXPECT_TRUE(choose_stage(members, error, 4, 4, 1e9, 4096).members.empty());
}

TEST(StageChoice, DearerBitsGiveFewerOfThemAndLargerErrors) {
  const Rows rows = make_rows(20000, 4, 7);
  double bits = 1e30, error = 0;
  for (const double price : {1e-5, 1e-4, 1e-3, 1e-2}) {
    const CodedVq c =
        code_vq(rows.values.data(), rows.weights.data(), rows.n, rows.dim, {}, by_cost(price));
    EXPECT_LT(component_bits(c), bits) << price;
    EXPECT_GT(c.weighted_distortion, error) << price;
    bits = component_bits(c);
    error = c.weighted_distortion;
  }
}

TEST(StageChoice, CostsNoMoreThanStagesByHand) {
  const Rows rows = make_rows(30000, 4, 9);
  const double price = 2e-4;
  const CodedVq chosen =
      code_vq(rows.values.data(), rows.weights.data(), rows.n, rows.dim, {}, by_cost(price));
  const std::vector<std::vector<float>> shares = {{1}, {1, 0.5f}, {1, 1}, {1, 0.5f, 0.25f}};
  for (const auto& stages : shares) {
    for (const uint32_t k : {64u, 256u, 1024u}) {
      ComponentSettings s = by_cost(0);
      s.codebook_size = k;
      s.stages = stages;
      const CodedVq fixed =
          code_vq(rows.values.data(), rows.weights.data(), rows.n, rows.dim, {}, s);
      EXPECT_LT(cost(chosen, price), cost(fixed, price)) << stages.size() << " stages, K=" << k;
    }
  }
}

TEST(StageChoice, HeavyRowsFarOffBecomeEscapes) {
  Rows rows = make_rows(5000, 4, 11);
  // Ten rows that no codebook will reach.
  for (size_t i = 0; i < 10; ++i) {
    for (size_t k = 0; k < 4; ++k)
      rows.values[400 * i * 4 + k] = 1000.0f * static_cast<float>(i + 1);
    rows.weights[400 * i] = 1e4f;
  }
  const CodedVq c =
      code_vq(rows.values.data(), rows.weights.data(), rows.n, rows.dim, {}, by_cost(1e-3));
  for (size_t i = 0; i < c.n; ++i) {
    if (c.depth[i] != kEscapeDepth) continue;
    EXPECT_TRUE(c.any_escape);
    for (size_t k = 0; k < 4; ++k) {
      EXPECT_NEAR(c.decoded[i * 4 + k], rows.values[i * 4 + k],
                  1e-3f * std::fabs(rows.values[i * 4 + k]) + 1e-4f);
    }
  }
  for (size_t i = 0; i < 10; ++i) {
    double e2 = 0;
    for (size_t k = 0; k < 4; ++k) {
      const double e = static_cast<double>(c.decoded[400 * i * 4 + k]) -
                       static_cast<double>(rows.values[400 * i * 4 + k]);
      e2 += e * e;
    }
    // Never more off than an escape would be worth.
    const bool escape = c.depth[400 * i] == kEscapeDepth;
    EXPECT_TRUE(escape || 1e4 * e2 <= 1e-3 * 16 * 4) << i << " " << e2;
  }
}

TEST(StageRefinement, LessErrorAtTheSameDepths) {
  const Rows rows = make_rows(20000, 6, 13);
  ComponentSettings s = by_cost(0);
  s.codebook_size = 256;
  s.stages = {1, 0.7f, 0.4f};
  const CodedVq greedy = code_vq(rows.values.data(), rows.weights.data(), rows.n, rows.dim, {}, s);
  double before = greedy.weighted_distortion;
  for (const int rounds : {1, 3}) {
    s.refine_rounds = rounds;
    const CodedVq joint = code_vq(rows.values.data(), rows.weights.data(), rows.n, rows.dim, {}, s);
    EXPECT_EQ(joint.depth, greedy.depth);
    EXPECT_LT(joint.weighted_distortion, 0.99 * before) << rounds;
    before = joint.weighted_distortion;
    // What the coder says is decoded is the sum of the codewords, in the decoder's order.
    for (size_t i = 0; i < joint.n; i += 97) {
      for (size_t k = 0; k < joint.dim; ++k) {
        float sum = joint.codebooks[0][joint.index[0][i] * joint.dim + k];
        for (size_t stage = 1; stage < joint.depth[i]; ++stage) {
          sum = sum + joint.codebooks[stage][joint.index[stage][i] * joint.dim + k];
        }
        ASSERT_EQ(sum, joint.decoded[i * joint.dim + k]);
      }
    }
    ComponentSettings more_threads = s;
    more_threads.threads = 3;
    const CodedVq again =
        code_vq(rows.values.data(), rows.weights.data(), rows.n, rows.dim, {}, more_threads);
    EXPECT_EQ(again.index, joint.index);
    EXPECT_EQ(again.codebooks, joint.codebooks);
  }
}

TEST(CodingCost, IsCloseToEntropyAndCountsLearning) {
  Random random(3);
  ChannelBits channel(2);
  double entropy = 0;
  const double p[2] = {0.5, 0.05};
  constexpr size_t kCount = 40000;
  for (size_t i = 0; i < kCount; ++i) {
    const size_t context = i % 2;
    const bool one = random.uniformf(0, 1) < static_cast<float>(p[context]);
    channel.add(context, one ? 1 : 0);
  }
  for (const double q : p) {
    entropy += kCount / 2.0 * (-q * std::log2(q) - (1 - q) * std::log2(1 - q));
  }
  EXPECT_NEAR(channel.total(), entropy, 0.02 * entropy);
  // One symbol costs about a bit where nothing is known of two.
  ChannelBits fresh(1);
  fresh.add(0, 1);
  EXPECT_NEAR(fresh.total(), 1, 1e-9);
}

}  // namespace
}  // namespace l4d
