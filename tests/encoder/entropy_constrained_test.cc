// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/entropy_constrained.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "encoder/search/kmeans.h"
#include "encoder/search/nearest.h"
#include "libl4dcodec/base/half.h"
#include "tests/common/random.h"

namespace l4d::test {
namespace {

constexpr size_t kDim = 4;
constexpr size_t kCount = 20000;

struct Data {
  std::vector<float> rows, weights;
};

// Points around some centres, with weights over several octaves, as trained scenes have them.
Data clustered(uint64_t seed) {
  Random random(seed);
  Data d;
  std::vector<float> centres(40 * kDim);
  for (float& c : centres) c = random.uniformf(-1, 1);
  for (size_t i = 0; i < kCount; ++i) {
    // Some clusters are larger than others.
    const double u = random.uniformf(0, 1);
    const size_t c = static_cast<size_t>(u * u * 39.99);
    for (size_t k = 0; k < kDim; ++k) {
      const float spread = random.uniformf(-1, 1) + random.uniformf(-1, 1) + random.uniformf(-1, 1);
      d.rows.push_back(centres[c * kDim + k] + 0.1f * spread);
    }
    d.weights.push_back(std::exp2(random.uniformf(-6, 6)));
  }
  return d;
}

struct Quantised {
  std::vector<float> codebook;
  std::vector<uint32_t> labels;

  double bits() const {
    std::vector<double> use(codebook.size() / kDim, 0.0);
    for (const uint32_t l : labels) use[l] += 1;
    double sum = 0;
    for (const double n : use) {
      if (n > 0) sum -= n * std::log2(n / kCount);
    }
    return sum / kCount;
  }
  double error(const Data& d) const {
    double sum = 0;
    for (size_t i = 0; i < kCount; ++i) {
      for (size_t k = 0; k < kDim; ++k) {
        const double e = static_cast<double>(d.rows[i * kDim + k]) -
                         static_cast<double>(codebook[labels[i] * kDim + k]);
        sum += static_cast<double>(d.weights[i]) * e * e;
      }
    }
    return sum / kCount;
  }
};

Quantised plain(const Data& d, size_t entries) {
  KMeansOptions options;
  options.num_codewords = entries;
  options.threads = 1;
  Quantised q;
  q.codebook = train_codebook(d.rows.data(), d.weights.data(), kCount, kDim, options).entries;
  for (float& v : q.codebook) v = half_to_float(float_to_half_saturate(v));
  q.labels.resize(kCount);
  std::vector<float> distance(kCount);
  assign_nearest(d.rows.data(), kCount, kDim, q.codebook.data(), q.codebook.size() / kDim, 1,
                 nullptr, q.labels.data(), distance.data());
  return q;
}

Quantised constrained(const Data& d, Quantised q, double price, int threads = 1) {
  EntropyConstraint c;
  c.price = price;
  c.rounds = 6;
  c.threads = threads;
  constrain_entropy(d.rows.data(), d.weights.data(), kCount, kDim, c, &q.codebook, &q.labels);
  return q;
}

TEST(EntropyConstrained, FewerBitsAtEqualWeightedError) {
  const Data d = clustered(3);
  const Quantised reference = plain(d, 256);
  const Quantised large = plain(d, 1024);
  double fewest = reference.bits();
  for (const double price : {0.25, 0.5, 1.0, 1.5, 2.0, 3.0}) {
    const Quantised q = constrained(d, large, price);
    if (q.error(d) <= reference.error(d)) fewest = std::min(fewest, q.bits());
  }
  RecordProperty("saved_percent", static_cast<int>(100 * (1 - fewest / reference.bits())));
  EXPECT_LE(fewest, 0.85 * reference.bits());
}

TEST(EntropyConstrained, HigherPricesMeanFewerBitsAndMoreError) {
  const Data d = clustered(4);
  Quantised last = plain(d, 256);
  for (const double price : {0.5, 2.0, 8.0}) {
    const Quantised q = constrained(d, plain(d, 256), price);
    EXPECT_LT(q.bits(), last.bits()) << price;
    EXPECT_GT(q.error(d), 0.95 * last.error(d)) << price;
    last = q;
  }
}

TEST(EntropyConstrained, NothingIsFreeOfCharge) {
  const Data d = clustered(5);
  const Quantised before = plain(d, 64);
  const Quantised q = constrained(d, before, 0);
  EXPECT_EQ(q.codebook, before.codebook);
  EXPECT_EQ(q.labels, before.labels);
}

TEST(EntropyConstrained, ThreadsDoNotMatter) {
  const Data d = clustered(6);
  const Quantised large = plain(d, 300);
  const Quantised one = constrained(d, large, 1, 1);
  const Quantised three = constrained(d, large, 1, 3);
  EXPECT_EQ(one.codebook, three.codebook);
  EXPECT_EQ(one.labels, three.labels);
  for (const float v : one.codebook) EXPECT_EQ(v, half_to_float(float_to_half_saturate(v)));
}

}  // namespace
}  // namespace l4d::test
