// SPDX-License-Identifier: Apache-2.0
#include "encoder/search/nearest.h"

#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <ostream>
#include <tuple>
#include <vector>

#include "encoder/search/nearest_grid.h"
#include "tests/encoder/vectors.h"

namespace l4d {
namespace {

using test::blobs;
using test::heavy_tails;
using test::lattice;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

struct Result {
  std::vector<uint32_t> labels;
  std::vector<float> sq_dist;
  bool operator==(const Result& o) const { return labels == o.labels && sq_dist == o.sq_dist; }
};
// How a failed comparison is shown.
std::ostream& operator<<(std::ostream& out, const Result& r) {
  return out << r.labels.size() << " labels";
}

Result assign(const std::vector<float>& points, size_t dim, const std::vector<float>& codebook,
              int threads = 1, const std::vector<uint32_t>* hint = nullptr,
              Axes axes = Axes::kAny) {
  Result r;
  const size_t n = points.size() / dim;
  r.labels.assign(n, 12345u);
  r.sq_dist.assign(n, -1.0f);
  assign_nearest(points.data(), n, dim, codebook.data(), codebook.size() / dim, threads,
                 hint == nullptr ? nullptr : hint->data(), r.labels.data(), r.sq_dist.data(), axes);
  return r;
}

// All targets ask for the same, and have it calculated once.
const Result& reference(const std::vector<float>& points, size_t dim,
                        const std::vector<float>& codebook) {
  using Question = std::tuple<size_t, std::vector<float>, std::vector<float>>;
  static std::map<Question, Result> answers;
  const auto [at, is_new] = answers.try_emplace({dim, points, codebook});
  Result& r = at->second;
  if (!is_new) return r;
  const size_t n = points.size() / dim;
  r.labels.resize(n);
  r.sq_dist.resize(n);
  assign_nearest_reference(points.data(), n, dim, codebook.data(), codebook.size() / dim, 0,
                           nullptr, r.labels.data(), r.sq_dist.data());
  return r;
}

// Distances to 1e-5, labels except where the two are that close to a tie.
void expect_close(const std::vector<float>& points, size_t dim, const std::vector<float>& codebook,
                  const Result& got) {
  const Result& want = reference(points, dim, codebook);
  for (size_t i = 0; i < want.labels.size(); ++i) {
    const double d = static_cast<double>(want.sq_dist[i]);
    ASSERT_NEAR(static_cast<double>(got.sq_dist[i]), d, 1e-5 * d + 1e-37) << "point " << i;
    if (got.labels[i] == want.labels[i]) continue;
    ASSERT_LT(got.labels[i], codebook.size() / dim);
    double other = 0;
    for (size_t j = 0; j < dim; ++j) {
      const double e = static_cast<double>(points[i * dim + j]) -
                       static_cast<double>(codebook[got.labels[i] * dim + j]);
      other += e * e;
    }
    ASSERT_NEAR(other, d, 1e-5 * d) << "point " << i << " is not near a tie";
  }
}

// Every SIMD target that is compiled in and that this machine has.
class NearestTest : public testing::TestWithParam<int64_t> {
 protected:
  void SetUp() override {
    if ((hwy::SupportedTargets() & GetParam()) == 0) {
      GTEST_SKIP() << hwy::TargetName(GetParam()) << " is not available on this machine";
    }
    hwy::SetSupportedTargetsForTest(GetParam());
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  void TearDown() override {
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
};

TEST_P(NearestTest, MatchesReferenceInAllShapes) {
  for (const size_t dim : {1u, 2u, 3u, 4u, 5u, 8u, 9u, 12u, 16u, 27u, 48u, 65u}) {
    for (const size_t k : {1u, 2u, 15u, 16u, 17u, 257u, 700u}) {
      SCOPED_TRACE(testing::Message() << "dim " << dim << " k " << k);
      // Enough points for a rotation at some dimensions, too few at others.
      const auto points = blobs(1100, dim, 300, dim);
      const auto codebook = blobs(k, dim, 300, dim);  // the same blobs
      expect_close(points, dim, codebook, assign(points, dim, codebook));
      const auto tails = heavy_tails(500, dim, 7);
      const auto tail_codebook = heavy_tails(k, dim, 8);
      expect_close(tails, dim, tail_codebook, assign(tails, dim, tail_codebook));
    }
  }
}

// Small integers have exact distances, so labels are those of the reference to the last tie,
// whatever the rotation of the search does to them.
TEST_P(NearestTest, TiesGoToTheLowestIndex) {
  for (const size_t dim : {1u, 3u, 4u, 6u, 12u, 27u, 48u}) {
    for (const int range : {1, 3}) {
      SCOPED_TRACE(testing::Message() << "dim " << dim << " range " << range);
      // Enough points for a rotation at each dimension.
      const auto points = lattice(1600, dim, range, 1);
      auto codebook = lattice(300, dim, range, 2);
      codebook.insert(codebook.end(), codebook.begin(), codebook.end());  // every one twice
      const Result& want = reference(points, dim, codebook);
      EXPECT_EQ(assign(points, dim, codebook), want);
      EXPECT_EQ(assign(points, dim, codebook, 1, nullptr, Axes::kPrincipal), want);
      for (const uint32_t label : want.labels) ASSERT_LT(label, 300u);
    }
  }
}

TEST_P(NearestTest, HintsAxesAndThreadsChangeNothing) {
  for (const size_t dim : {3u, 4u, 7u, 12u, 48u}) {
    SCOPED_TRACE(dim);
    const auto points = blobs(5000, dim, 50, 3);
    const auto codebook = blobs(900, dim, 50, 4);
    const Result want = assign(points, dim, codebook);
    test::Random random(5);
    std::vector<uint32_t> hint(5000);
    for (uint32_t& h : hint) h = random.below(900);
    EXPECT_EQ(assign(points, dim, codebook, 1, &hint), want);
    for (uint32_t& h : hint) h = static_cast<uint32_t>(random.bits());  // mostly no codeword
    EXPECT_EQ(assign(points, dim, codebook, 2, &hint), want);
    hint = want.labels;
    EXPECT_EQ(assign(points, dim, codebook, 7, &hint), want);
    EXPECT_EQ(assign(points, dim, codebook, 2, nullptr, Axes::kPrincipal), want);
  }
}

TEST_P(NearestTest, HintMayBeTheOutput) {
  const auto points = blobs(3000, 48, 50, 3);
  const auto codebook = blobs(300, 48, 50, 4);
  const Result want = assign(points, 48, codebook);
  Result got = want;
  assign_nearest(points.data(), 3000, 48, codebook.data(), 300, 2, got.labels.data(),
                 got.labels.data(), got.sq_dist.data());
  EXPECT_EQ(got, want);
}

// Far from the origin, and far from each other, the slack for rounding has to widen.
TEST_P(NearestTest, OffsetsAndScalesKeepTheResultExact) {
  for (const size_t dim : {4u, 12u, 48u}) {
    for (const float scale : {1e-25f, 1e-18f, 1e-3f, 1e15f}) {
      SCOPED_TRACE(testing::Message() << "dim " << dim << " scale " << scale);
      auto points = lattice(1600, dim, 2, 6);
      auto codebook = lattice(400, dim, 2, 7);
      const Result& want = reference(points, dim, codebook);
      // Powers of two apart, a lattice stays exact: labels must not move. Subnormal squares lose
      // their ties, so those are only required to be in range.
      const float power = std::exp2(std::round(std::log2(scale)));
      for (float& v : points) v *= power;
      for (float& v : codebook) v *= power;
      const Result got = assign(points, dim, codebook);
      if (scale > 1e-20f) {
        EXPECT_EQ(got.labels, want.labels);
      } else {
        for (const uint32_t label : got.labels) ASSERT_LT(label, 400u);
      }
    }
    auto points = lattice(1600, dim, 2, 6);
    auto codebook = lattice(400, dim, 2, 7);
    const Result& want = reference(points, dim, codebook);
    for (float& v : points) v += 65536.0f;
    for (float& v : codebook) v += 65536.0f;
    EXPECT_EQ(assign(points, dim, codebook), want);
  }
}

TEST_P(NearestTest, NumbersThatAreNone) {
  for (const size_t dim : {4u, 48u}) {
    SCOPED_TRACE(dim);
    auto points = blobs(2000, dim, 20, 8);
    auto codebook = blobs(200, dim, 20, 9);
    std::fill_n(codebook.begin(), dim, kNan);
    codebook[5 * dim + 2] = kInfinity;
    const Result want = reference(points, dim, codebook);
    expect_close(points, dim, codebook, assign(points, dim, codebook));
    for (const uint32_t label : want.labels) {
      ASSERT_NE(label, 0u);
      ASSERT_NE(label, 5u);
    }
    points[3 * dim + 1] = kNan;
    points[4 * dim] = kInfinity;
    points[6 * dim] = 1e30f;  // its distances overflow
    std::vector<uint32_t> hint(2000, 7);
    const std::vector<uint32_t>* const hints[] = {nullptr, &hint};
    for (const auto* h : hints) {
      const Result got = assign(points, dim, codebook, 2, h);
      for (const size_t i : {3u, 4u, 6u}) {
        EXPECT_EQ(got.labels[i], 0u);
        EXPECT_EQ(got.sq_dist[i], kInfinity);
      }
      EXPECT_EQ(got.labels[5], want.labels[5]);
    }
  }
}

TEST_P(NearestTest, UpdateEqualsAssignmentToTheWholeCodebook) {
  for (const size_t dim : {4u, 12u, 48u}) {
    SCOPED_TRACE(dim);
    const auto points = lattice(3000, dim, 2, 10);
    const auto codebook = lattice(420, dim, 2, 11);
    const Result want = assign(points, dim, codebook);
    Result got;
    got.labels.assign(3000, 0);
    got.sq_dist.assign(3000, kInfinity);
    size_t first = 0;
    for (const size_t count : {1u, 1u, 3u, 15u, 100u, 300u}) {
      update_nearest(points.data(), 3000, dim, codebook.data() + first * dim, count,
                     static_cast<uint32_t>(first), 2, got.labels.data(), got.sq_dist.data());
      first += count;
    }
    ASSERT_EQ(first, 420u);
    EXPECT_EQ(got, want);
  }
}

// The grid on its own, as few points as it takes.
Result on_grid(const std::vector<float>& points, size_t dim, const std::vector<float>& codebook,
               Result known = {}, const std::vector<uint32_t>* hint = nullptr) {
  const size_t n = points.size() / dim;
  const bool keep = !known.labels.empty();
  known.labels.resize(n);
  known.sq_dist.resize(n);
  const NearestGrid grid(codebook.data(), codebook.size() / dim, dim, points.data(), 1);
  search_grid(grid,
              {points.data(), hint == nullptr ? nullptr : hint->data(), 0, known.labels.data(),
               known.sq_dist.data(), keep},
              0, n);
  return known;
}

TEST_P(NearestTest, GridFindsWhatTheTreeFinds) {
  for (const size_t dim : {9u, 12u, 27u, 48u, 65u}) {
    for (const size_t k : {1u, 31u, 33u, 257u}) {
      SCOPED_TRACE(testing::Message() << "dim " << dim << " k " << k);
      // A point far out is in heavy tails and beyond the grid; one codeword in blobs is, too.
      const auto tails = heavy_tails(70, dim, 7);
      const auto tail_codebook = heavy_tails(k, dim, 8);
      EXPECT_EQ(on_grid(tails, dim, tail_codebook), assign(tails, dim, tail_codebook));
      const auto points = blobs(70, dim, 1, dim);
      auto codebook = blobs(k, dim, 1, dim + 1);
      codebook[(k - 1) * dim] = 1e9f;
      const Result want = assign(points, dim, codebook);
      EXPECT_EQ(on_grid(points, dim, codebook), want);
      std::vector<uint32_t> hint(70, static_cast<uint32_t>(k - 1));
      hint[0] = static_cast<uint32_t>(k);  // no codeword
      EXPECT_EQ(on_grid(points, dim, codebook, {}, &hint), want);
      EXPECT_EQ(on_grid(points, dim, codebook, {std::vector<uint32_t>(70, 7), want.sq_dist}).labels,
                std::vector<uint32_t>(70, 7));  // what is known wins ties
    }
  }
}

TEST_P(NearestTest, GridKeepsTiesScalesAndNumbersThatAreNone) {
  constexpr size_t kDim = 12;
  auto points = lattice(70, kDim, 1, 1);
  auto codebook = lattice(150, kDim, 1, 2);
  codebook.insert(codebook.end(), codebook.begin(), codebook.end());  // every one twice
  EXPECT_EQ(on_grid(points, kDim, codebook), reference(points, kDim, codebook));
  for (const float scale : {1e-30f, 1e-19f, 1e15f, 1e25f}) {
    auto far_points = points, far_codebook = codebook;
    for (float& v : far_points) v *= scale;
    for (float& v : far_codebook) v *= scale;
    EXPECT_EQ(on_grid(far_points, kDim, far_codebook), assign(far_points, kDim, far_codebook));
  }
  codebook[0] = kNan;
  codebook[kDim + 1] = kInfinity;
  points[2 * kDim] = kNan;
  points[3 * kDim] = -kInfinity;
  points[4 * kDim] = 1e30f;
  EXPECT_EQ(on_grid(points, kDim, codebook), assign(points, kDim, codebook));
  const std::vector<float> none(2 * kDim, kNan);
  EXPECT_EQ(on_grid(points, kDim, none), assign(points, kDim, none));
}

// Noise, of which the tree rules nothing out, in as many points as make the search change over.
TEST_P(NearestTest, SearchOfNoiseIsExact) {
  const auto points = blobs(4096, 12, 1, 3);
  const auto codebook = blobs(64, 12, 1, 4);
  expect_close(points, 12, codebook, assign(points, 12, codebook, 2));
}

TEST_P(NearestTest, LargestCodebook) {
  const auto points = blobs(300, 4, 5000, 12);
  const auto codebook = blobs(65536, 4, 5000, 12);
  expect_close(points, 4, codebook, assign(points, 4, codebook));
  const auto sh = blobs(60, 48, 5000, 13);
  const auto sh_codebook = blobs(20000, 48, 5000, 13);
  expect_close(sh, 48, sh_codebook, assign(sh, 48, sh_codebook));
}

TEST_P(NearestTest, NoPoints) {
  const std::vector<float> codebook(4, 1.0f);
  assign_nearest(nullptr, 0, 4, codebook.data(), 1, 0, nullptr, nullptr, nullptr);
  update_nearest(nullptr, 0, 4, codebook.data(), 1, 0, 0, nullptr, nullptr);
  // Nothing is written where there is no point.
  const std::vector<float> point(4, 1.0f);
  uint32_t label = 7;
  float sq_dist = 7;
  assign_nearest(point.data(), 0, 4, codebook.data(), 1, 0, nullptr, &label, &sq_dist);
  update_nearest(point.data(), 0, 4, codebook.data(), 1, 3, 0, &label, &sq_dist);
  EXPECT_EQ(label, 7u);
  EXPECT_EQ(sq_dist, 7);
}

TEST_P(NearestTest, RealVectors) {
  const std::string folder = test::basketball_folder();
  if (folder.empty()) GTEST_SKIP() << "no basketball scene in $L4D_DATA_DIR or ../shared/data";
  const test::RealVectors real = test::read_basketball(folder, 97);
  const auto check = [&](const std::vector<float>& points, size_t dim) {
    std::vector<float> codebook;
    for (size_t i = 0; i < real.n; i += 3) {
      codebook.insert(codebook.end(), points.begin() + static_cast<std::ptrdiff_t>(i * dim),
                      points.begin() + static_cast<std::ptrdiff_t>((i + 1) * dim));
    }
    expect_close(points, dim, codebook, assign(points, dim, codebook, 2));
  };
  check(real.sh, 48);
  check(real.temporal_rotor, 4);
}

std::vector<int64_t> compiled_targets() {
  std::vector<int64_t> targets;
  for (int64_t rest = HWY_TARGETS; rest != 0; rest &= rest - 1) targets.push_back(rest & -rest);
  return targets;
}

INSTANTIATE_TEST_SUITE_P(Targets, NearestTest, testing::ValuesIn(compiled_targets()),
                         [](const testing::TestParamInfo<int64_t>& target) {
                           return std::string(hwy::TargetName(target.param));
                         });

}  // namespace
}  // namespace l4d
