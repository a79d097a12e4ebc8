// SPDX-License-Identifier: Apache-2.0
// The device's search for the nearest codeword against the host's: equal to the last bit, and so are the
// files that come of it.
#include "encoder/nearest.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "encoder/cuda/device_nearest.h"
#include "encoder/kmeans.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/common/test_scene.h"
#include "tests/gpu/device.h"

namespace l4d {
namespace {

using test::Random;

class DeviceNearest : public test::OnDevice<testing::Test> {};

std::vector<float> normal(size_t n, size_t dim, uint64_t seed) {
  Random random(seed);
  std::vector<float> v(n * dim);
  for (size_t i = 0; i < v.size(); ++i) {
    v[i] = static_cast<float>(random.normal() / (1.0 + 0.2 * static_cast<double>(i % dim)));
  }
  return v;
}

// Counts how many searches went to the device.
class Counting : public NearestDevice {
 public:
  bool search(const Job& job) override {
    const bool done = device_->search(job);
    count += done;
    return done;
  }
  size_t count = 0;

 private:
  std::unique_ptr<NearestDevice> device_ = cuda::make_device_nearest(0, 2);
};

struct Result {
  std::vector<uint32_t> labels;
  std::vector<float> sq_dist;
};
Result poisoned(size_t n) { return {std::vector<uint32_t>(n, 0xdeadbeefu), std::vector<float>(n, -7.0f)}; }

void expect_equal(const Result& a, const Result& b) {
  ASSERT_EQ(a.labels, b.labels);
  ASSERT_EQ(std::memcmp(a.sq_dist.data(), b.sq_dist.data(), a.sq_dist.size() * sizeof(float)), 0);
}

TEST_F(DeviceNearest, IsTheHostsToTheLastBit) {
  Counting device;
  size_t searches = 0;
  for (const size_t dim : std::initializer_list<size_t>{3, 4, 5, 12, 13, 27, 28, 48, 49}) {
    for (const size_t k : {size_t{1000}, size_t{4096}}) {
      SCOPED_TRACE("dim " + std::to_string(dim) + ", k " + std::to_string(k));
      const size_t n = 30011;
      std::vector<float> points = normal(n, dim, dim), book = normal(k, dim, 1000 + k);
      // Ties: points on codewords, and codewords twice.
      std::copy_n(book.begin(), 100 * dim, points.begin());
      std::copy_n(book.begin(), 50 * dim, book.end() - static_cast<std::ptrdiff_t>(50 * dim));
      points[200 * dim] = std::numeric_limits<float>::quiet_NaN();
      points[201 * dim] = 1e30f;
      points[202 * dim] = std::numeric_limits<float>::infinity();
      Result host = poisoned(n), got = poisoned(n);
      assign_nearest(points.data(), n, dim, book.data(), k, 0, nullptr, host.labels.data(),
                     host.sq_dist.data());
      assign_nearest(points.data(), n, dim, book.data(), k, {0, &device}, nullptr, got.labels.data(),
                     got.sq_dist.data());
      expect_equal(host, got);
      EXPECT_EQ(device.count, ++searches);
      // Codewords that join, half of the points being known.
      const std::vector<float> more = normal(k, dim, 2000 + k);
      for (size_t i = 0; i < n; i += 2) host.sq_dist[i] *= 0.5f;
      got = host;
      update_nearest(points.data(), n, dim, more.data(), k, static_cast<uint32_t>(k), 0,
                     host.labels.data(), host.sq_dist.data());
      update_nearest(points.data(), n, dim, more.data(), k, static_cast<uint32_t>(k), {0, &device},
                     got.labels.data(), got.sq_dist.data());
      expect_equal(host, got);
      EXPECT_EQ(device.count, ++searches);
    }
  }
}

TEST_F(DeviceNearest, SlicesOfManyPointsAreOne) {
  Counting device;
  const size_t n = 700001, dim = 12, k = 64;  // several slices of 8 MiB
  const std::vector<float> points = normal(n, dim, 5), book = normal(k, dim, 6);
  Result host = poisoned(n), got = poisoned(n);
  assign_nearest(points.data(), n, dim, book.data(), k, 0, nullptr, host.labels.data(),
                 host.sq_dist.data());
  assign_nearest(points.data(), n, dim, book.data(), k, {0, &device}, nullptr, got.labels.data(),
                 got.sq_dist.data());
  expect_equal(host, got);
  EXPECT_EQ(device.count, 1u);
}

TEST_F(DeviceNearest, LeavesWhatIsSmallToTheHost) {
  Counting device;
  const std::vector<float> points = normal(100, 4, 5), book = normal(8, 4, 6);
  Result got = poisoned(100);
  assign_nearest(points.data(), 100, 4, book.data(), 8, {1, &device}, nullptr, got.labels.data(),
                 got.sq_dist.data());
  EXPECT_EQ(device.count, 0u);
  EXPECT_LT(got.labels[0], 8u);
}

TEST_F(DeviceNearest, CodebooksAreTheHosts) {
  for (const size_t dim : {size_t{4}, size_t{48}}) {
    const size_t n = 60000;
    const std::vector<float> points = normal(n, dim, 7);
    KMeansOptions options;
    options.num_codewords = 1024;
    options.seed = 3;
    const Codebook host = train_codebook(points.data(), nullptr, n, dim, options);
    Counting device;
    options.device = &device;
    const Codebook got = train_codebook(points.data(), nullptr, n, dim, options);
    EXPECT_EQ(host.entries, got.entries);
    EXPECT_EQ(host.weighted_distortion, got.weighted_distortion);
    EXPECT_GT(device.count, 3u);
  }
}

TEST_F(DeviceNearest, FilesAreTheHosts) {
  test::SceneOptions s;
  s.count = 40000;
  s.sh_degree = 3;
  const test::TestScene scene = test::make_scene(s);
  for (const char* preset : {"indexed", "paper-small", "default"}) {
    Bytes files[2];
    for (const uint32_t backend : {L4D_BACKEND_CPU, L4D_BACKEND_CUDA}) {
      l4d_encoder_options options;
      l4d_encoder_options_init(&options);
      options.backend = backend;
      EncoderHandle e(&options);
      e.check(l4d_encoder_set_preset(e.get(), preset));
      e.check(l4d_encoder_set(e.get(), L4D_ENC_PRUNE_WEIGHT, L4D_ALL_COMPONENTS, -1));
      const l4d_gaussians view = scene.view();
      e.check(l4d_encoder_set_scene(e.get(), &view, &scene.timeline, nullptr));
      files[backend == L4D_BACKEND_CUDA] = e.encode();
    }
    EXPECT_EQ(files[0], files[1]) << preset;
  }
}

}  // namespace
}  // namespace l4d
