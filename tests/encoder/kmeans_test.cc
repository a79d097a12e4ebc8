// SPDX-License-Identifier: Apache-2.0
#include "encoder/search/kmeans.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <set>
#include <vector>

#include "encoder/search/kmeans_seed.h"
#include "encoder/search/nearest.h"
#include "tests/encoder/vectors.h"

namespace l4d {
namespace {

using test::blobs;
using test::heavy_tails;

KMeansOptions options_for(size_t k, int threads = 1, uint64_t seed = 1) {
  KMeansOptions o;
  o.num_codewords = k;
  o.threads = threads;
  o.seed = seed;
  return o;
}

Codebook train(const std::vector<float>& points, size_t dim, const KMeansOptions& options,
               const std::vector<float>* weights = nullptr) {
  return train_codebook(points.data(), weights == nullptr ? nullptr : weights->data(),
                        points.size() / dim, dim, options);
}

// Weighted distortion of nearest assignment.
double distortion(const std::vector<float>& points, size_t dim, const std::vector<float>& codebook,
                  const std::vector<float>& weights, std::vector<uint32_t>* labels = nullptr) {
  const size_t n = points.size() / dim;
  std::vector<uint32_t> label(n);
  std::vector<float> sq_dist(n);
  assign_nearest(points.data(), n, dim, codebook.data(), codebook.size() / dim, 0,
                 labels != nullptr && labels->size() == n ? labels->data() : nullptr, label.data(),
                 sq_dist.data());
  double sum = 0;
  for (size_t i = 0; i < n; ++i) {
    sum += static_cast<double>(weights[i]) * static_cast<double>(sq_dist[i]);
  }
  if (labels != nullptr) *labels = label;
  return sum;
}

// The textbook: random distinct points to start from, every point in every iteration.
double plain_lloyd(const std::vector<float>& points, size_t dim, const std::vector<float>& weights,
                   size_t k, int iterations) {
  const size_t n = points.size() / dim;
  test::Random random(3);
  std::set<uint32_t> start;
  while (start.size() < k) start.insert(random.below(static_cast<uint32_t>(n)));
  std::vector<float> codebook;
  for (const uint32_t i : start) {
    codebook.insert(codebook.end(), points.data() + i * dim, points.data() + (i + 1) * dim);
  }
  std::vector<uint32_t> labels;
  for (int it = 0; it < iterations; ++it) {
    distortion(points, dim, codebook, weights, &labels);
    std::vector<double> sum(k * dim, 0.0), total(k, 0.0);
    for (size_t i = 0; i < n; ++i) {
      const double w = static_cast<double>(weights[i]);
      total[labels[i]] += w;
      for (size_t j = 0; j < dim; ++j) {
        sum[labels[i] * dim + j] += w * static_cast<double>(points[i * dim + j]);
      }
    }
    for (size_t c = 0; c < k * dim; ++c) {
      if (total[c / dim] > 0) codebook[c] = static_cast<float>(sum[c] / total[c / dim]);
    }
  }
  return distortion(points, dim, codebook, weights);
}

std::set<std::vector<float>> distinct(const std::vector<float>& rows, size_t dim) {
  std::set<std::vector<float>> out;
  for (size_t i = 0; i < rows.size(); i += dim) {
    out.emplace(rows.begin() + static_cast<std::ptrdiff_t>(i),
                rows.begin() + static_cast<std::ptrdiff_t>(i + dim));
  }
  return out;
}

TEST(KMeansTest, NoPoints) {
  const Codebook codebook = train_codebook(nullptr, nullptr, 0, 4, options_for(16));
  EXPECT_EQ(codebook.size(), 0u);
  EXPECT_EQ(codebook.weighted_distortion, 0);
}

TEST(KMeansTest, OnePoint) {
  const std::vector<float> point = {1.5f, -2.25f, 0.1f, 1e-20f};
  for (const size_t k : {0u, 1u, 4096u}) {
    const Codebook codebook = train(point, 4, options_for(k));
    EXPECT_EQ(codebook.entries, point);
    EXPECT_EQ(codebook.weighted_distortion, 0);
  }
}

TEST(KMeansTest, FewDistinctPointsAreKeptExactly) {
  for (const size_t dim : {3u, 4u, 12u, 48u}) {
    for (const size_t count : {1u, 2u, 37u}) {
      if (count < 37 && dim > 3) continue;  // dimensions have no part in how few there are
      SCOPED_TRACE(testing::Message() << "dim " << dim << " distinct " << count);
      const std::vector<float> few = blobs(count, dim, 5, dim);
      std::vector<float> points, weights;
      test::Random random(1);
      for (size_t i = 0; i < 9000; ++i) {
        const size_t c = i < count ? i : random.below(static_cast<uint32_t>(count));
        points.insert(points.end(), few.begin() + static_cast<std::ptrdiff_t>(c * dim),
                      few.begin() + static_cast<std::ptrdiff_t>((c + 1) * dim));
        weights.push_back(random.uniformf(0.1, 1));
      }
      for (const size_t k : {37u, 100u, 5000u}) {  // trained on a sample, and on all
        const Codebook codebook = train(points, dim, options_for(k), &weights);
        EXPECT_EQ(codebook.size(), count);
        EXPECT_EQ(distinct(codebook.entries, dim), distinct(few, dim));
        EXPECT_EQ(codebook.weighted_distortion, 0);
      }
    }
  }
}

TEST(KMeansTest, MoreCodewordsThanPoints) {
  const std::vector<float> points = blobs(50, 48, 50, 2);
  const Codebook codebook = train(points, 48, options_for(4096));
  EXPECT_EQ(distinct(codebook.entries, 48), distinct(points, 48));
}

TEST(KMeansTest, OneCodewordIsTheWeightedMean) {
  const std::vector<float> points = {0, 0, 0, 4, 8, 0};
  const std::vector<float> weights = {1, 3, 0};
  KMeansOptions options = options_for(1);
  options.sample_per_codeword = 100;
  const Codebook codebook = train(points, 2, options, &weights);
  EXPECT_EQ(codebook.entries, (std::vector<float>{0, 3}));
  EXPECT_EQ(codebook.weighted_distortion, 12);
}

TEST(KMeansTest, ZeroWeights) {
  // All of them: as if there were none.
  const std::vector<float> points = blobs(3000, 4, 40, 3);
  const std::vector<float> zeros(3000, 0.0f), ones(3000, 1.0f);
  EXPECT_EQ(train(points, 4, options_for(64), &zeros).entries,
            train(points, 4, options_for(64), &ones).entries);
  EXPECT_EQ(train(points, 4, options_for(64), &ones).entries,
            train(points, 4, options_for(64)).entries);
  // Some: such points get no codeword, however far out they are.
  std::vector<float> with_strays = points, weights = ones;
  for (size_t i = 0; i < 3000; i += 3) {
    with_strays[i * 4] += 1000;
    weights[i] = 0;
  }
  for (const size_t k : {16u, 64u, 2999u}) {
    const Codebook codebook = train(with_strays, 4, options_for(k), &weights);
    EXPECT_LE(codebook.size(), k);
    for (const float v : codebook.entries) ASSERT_LT(std::abs(v), 100);
  }
}

TEST(KMeansTest, SeparatedBlobsGetOneCodewordEach) {
  for (const size_t dim : {4u, 12u, 48u}) {
    std::vector<float> points = blobs(40000, dim, 1, 5);
    for (size_t i = 0; i < 40000; ++i) {
      points[i * dim + i % 2] += static_cast<float>(100 * (i % 100));
    }
    const std::vector<float> weights(40000, 1.0f);
    const Codebook codebook = train(points, dim, options_for(100), &weights);
    EXPECT_EQ(codebook.size(), 100u);
    const double noise = 0.05 * 0.05 * static_cast<double>(dim) * 40000;
    EXPECT_NEAR(codebook.weighted_distortion / noise, 1, 0.03);  // of a sample
    EXPECT_NEAR(distortion(points, dim, codebook.entries, weights) / noise, 1, 0.01);
  }
}

TEST(KMeansTest, SameBitsForAnyNumberOfThreads) {
  for (const size_t dim : {4u, 27u, 48u}) {
    const std::vector<float> points = heavy_tails(30000, dim, 6);
    std::vector<float> weights;
    test::Random random(7);
    for (size_t i = 0; i < 30000; ++i) weights.push_back(random.uniformf(0, 1));
    for (const size_t k : {200u, 3000u}) {  // a sample, then all
      const Codebook one = train(points, dim, options_for(k, 1), &weights);
      for (const int threads : {2, 7}) {
        const Codebook more = train(points, dim, options_for(k, threads), &weights);
        EXPECT_EQ(one.entries, more.entries);
        EXPECT_EQ(one.weighted_distortion, more.weighted_distortion);
      }
      EXPECT_NE(one.entries, train(points, dim, options_for(k, 1, 2), &weights).entries);
    }
  }
}

// Searches as a device does them, of points that it has taken in once.
class HoldingDevice : public NearestDevice {
 public:
  struct Held : HeldPoints {
    std::vector<float> points;
    size_t dim = 0;
  };
  std::unique_ptr<HeldPoints> hold(const float* points, size_t n, size_t dim, size_t) override {
    auto held = std::make_unique<Held>();
    held->points.assign(points, points + n * dim);
    held->dim = dim;
    ++holds;
    return held;
  }
  bool search(const Job& job) override {
    if (job.held == nullptr) return false;
    const Held& held = static_cast<Held&>(*job.held);
    EXPECT_EQ(held.dim, job.dim);
    EXPECT_EQ(held.points, std::vector<float>(job.points, job.points + job.n * job.dim));
    if (job.keep) {
      update_nearest(held.points.data(), job.n, job.dim, job.codebook, job.k, job.first_label, 1,
                     job.labels, job.sq_dist);
    } else {
      assign_nearest(held.points.data(), job.n, job.dim, job.codebook, job.k, 1, nullptr,
                     job.labels, job.sq_dist);
    }
    ++searches;
    return true;
  }
  size_t holds = 0, searches = 0;
};

TEST(KMeansTest, PointsThatADeviceHoldsAreThoseSearched) {
  for (const size_t dim : {4u, 48u}) {  // as they are, and along other axes
    const std::vector<float> points = heavy_tails(30000, dim, 6);
    for (const size_t k : {200u, 2000u}) {  // two samples, then all
      KMeansOptions options = options_for(k);
      const Codebook host = train(points, dim, options);
      HoldingDevice device;
      options.device = &device;
      const Codebook got = train(points, dim, options);
      EXPECT_EQ(host.entries, got.entries);
      EXPECT_EQ(host.weighted_distortion, got.weighted_distortion);
      EXPECT_EQ(device.holds, k == 200 ? 2u : 1u);
      EXPECT_GT(device.searches, 10u);
    }
  }
}

TEST(KMeansTest, CancelledTrainingStillReturnsACodebook) {
  const std::vector<float> points = blobs(20000, 4, 300, 8);
  int asked = 0;
  const std::function<bool()> after_two = [&] { return ++asked > 2; };
  KMeansOptions options = options_for(100);
  options.cancelled = &after_two;
  const Codebook codebook = train(points, 4, options);
  EXPECT_GE(codebook.size(), 1u);
  EXPECT_LE(asked, 4);
  const std::function<bool()> at_once = [] { return true; };
  options.cancelled = &at_once;
  EXPECT_GE(train(points, 4, options).size(), 1u);
}

TEST(KMeansTest, SampleStandsForAllPoints) {
  const size_t n = 50000;
  const std::vector<float> points = heavy_tails(n, 4, 9);
  std::vector<float> weights;
  test::Random random(10);
  for (size_t i = 0; i < n; ++i) weights.push_back(i % 5 == 0 ? 0.0f : random.uniformf(0, 2));
  Random draws(11);
  const PointSample sample = draw_sample(points.data(), weights.data(), n, 4, 2000, 2, draws);
  EXPECT_NEAR(static_cast<double>(sample.index.size()), 2000, 200);
  EXPECT_TRUE(std::is_sorted(sample.index.begin(), sample.index.end()));
  EXPECT_EQ(std::set<uint32_t>(sample.index.begin(), sample.index.end()).size(),
            sample.index.size());
  // Total weight and weighted energy are those of all points within the noise of 2000 draws.
  double weight = 0, energy = 0, all_weight = 0, all_energy = 0;
  const auto squares = [&](size_t i) {
    double sum = 0;
    for (size_t j = 0; j < 4; ++j) {
      sum += static_cast<double>(points[i * 4 + j]) * static_cast<double>(points[i * 4 + j]);
    }
    return sum;
  };
  for (size_t s = 0; s < sample.index.size(); ++s) {
    ASSERT_GT(weights[sample.index[s]], 0);
    weight += static_cast<double>(sample.weight[s]);
    energy += static_cast<double>(sample.weight[s]) * squares(sample.index[s]);
  }
  for (size_t i = 0; i < n; ++i) {
    all_weight += static_cast<double>(weights[i]);
    all_energy += static_cast<double>(weights[i]) * squares(i);
  }
  EXPECT_NEAR(weight / all_weight, 1, 0.1);
  EXPECT_NEAR(energy / all_energy, 1, 0.1);
}

TEST(KMeansTest, SeedingIsAnAssignmentToDistinctPoints) {
  const std::vector<float> points = test::lattice(3000, 4, 2, 12);  // at most 625 distinct
  const std::vector<float> weights(3000, 1.0f);
  Random random(13);
  const Seeding s = seed_centroids(points.data(), weights.data(), 3000, 4, 2000, 2, random);
  EXPECT_EQ(distinct(s.centroids, 4), distinct(points, 4));
  EXPECT_EQ(s.centroids.size() / 4, distinct(points, 4).size());
  for (size_t i = 0; i < 3000; ++i) {
    ASSERT_EQ(s.sq_dist[i], 0);
    ASSERT_TRUE(std::equal(points.data() + i * 4, points.data() + (i + 1) * 4,
                           s.centroids.data() + s.labels[i] * 4));
  }
}

// Uniform starts leave the far points of such data to a handful of codewords.
TEST(KMeansTest, HeavyTailsAreServed) {
  const std::vector<float> points = heavy_tails(40000, 4, 14);
  const std::vector<float> weights(40000, 1.0f);
  const Codebook codebook = train(points, 4, options_for(512), &weights);
  const double ours = distortion(points, 4, codebook.entries, weights);
  EXPECT_LT(ours, 0.5 * plain_lloyd(points, 4, weights, 512, 30));
}

// A sample, seeding in rounds and an early end must not cost quality.
TEST(KMeansNightly, RealVectorsComparedWithLongPlainLloyd) {
  const std::string folder = test::basketball_folder();
  if (folder.empty()) GTEST_SKIP() << "no basketball scene in $L4D_DATA_DIR or ../shared/data";
  const test::RealVectors real = test::read_basketball(folder, 5);
  const auto compare = [&](const char* name, const std::vector<float>& points, size_t dim) {
    constexpr size_t kEntries = 512;
    const Codebook codebook = train(points, dim, options_for(kEntries), &real.sh_weight);
    const double ours = distortion(points, dim, codebook.entries, real.sh_weight);
    const double plain = plain_lloyd(points, dim, real.sh_weight, kEntries, 30);
    std::printf("%s: weighted distortion %.6g, plain Lloyd %.6g, ratio %.4f\n", name, ours, plain,
                ours / plain);
    EXPECT_LT(ours, 1.02 * plain);
    EXPECT_NEAR(codebook.weighted_distortion / ours, 1, 0.03);
  };
  compare("SH", real.sh, 48);
  compare("temporal rotor", real.temporal_rotor, 4);
}

}  // namespace
}  // namespace l4d
