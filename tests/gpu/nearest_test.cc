// SPDX-License-Identifier: Apache-2.0
// The device's search for the nearest codeword against the host's: equal to the last bit, and so
// are the files that come of it.
#include "encoder/search/nearest.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <thread>

#include "encoder/search/cuda/device_nearest.h"
#include "encoder/search/kmeans.h"
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

// Counts how many searches went to the device, and how often points stayed there.
class Counting : public NearestDevice {
 public:
  bool search(const Job& request) override {
    const bool done = device_->search(request);
    count += done;
    return done;
  }
  std::unique_ptr<HeldPoints> hold(const float* points, size_t n, size_t dim, size_t k) override {
    std::unique_ptr<HeldPoints> held = device_->hold(points, n, dim, k);
    holds += held != nullptr;
    return held;
  }
  std::atomic<size_t> count{0}, holds{0};

 private:
  std::unique_ptr<NearestDevice> device_ = cuda::make_device_nearest(0, 2);
};

struct Result {
  std::vector<uint32_t> labels;
  std::vector<float> sq_dist;
};
Result poisoned(size_t n) {
  return {std::vector<uint32_t>(n, 0xdeadbeefu), std::vector<float>(n, -7.0f)};
}

void expect_equal(const Result& a, const Result& b) {
  ASSERT_EQ(a.labels, b.labels);
  ASSERT_EQ(std::memcmp(a.sq_dist.data(), b.sq_dist.data(), a.sq_dist.size() * sizeof(float)), 0);
}

TEST_F(DeviceNearest, IsTheHostsToTheLastBit) {
  Counting device;
  size_t searches = 0;
  for (const size_t dim : std::initializer_list<size_t>{3, 4, 12, 27, 48}) {
    for (const size_t k : {size_t{1000}, size_t{4096}}) {
      SCOPED_TRACE("dim " + std::to_string(dim) + ", k " + std::to_string(k));
      const size_t n = 30011;
      std::vector<float> points = normal(n, dim, dim), codebook = normal(k, dim, 1000 + k);
      // Ties: points on codewords, and codewords twice.
      std::copy_n(codebook.begin(), 100 * dim, points.begin());
      std::copy_n(codebook.begin(), 50 * dim,
                  codebook.end() - static_cast<std::ptrdiff_t>(50 * dim));
      points[200 * dim] = std::numeric_limits<float>::quiet_NaN();
      points[201 * dim] = 1e30f;
      points[202 * dim] = std::numeric_limits<float>::infinity();
      Result host = poisoned(n), got = poisoned(n);
      assign_nearest(points.data(), n, dim, codebook.data(), k, 0, nullptr, host.labels.data(),
                     host.sq_dist.data());
      assign_nearest(points.data(), n, dim, codebook.data(), k, {0, &device}, nullptr,
                     got.labels.data(), got.sq_dist.data());
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
  const size_t n = 700001, dim = 12, k = 64;  // several slices of 4 MiB
  const std::vector<float> points = normal(n, dim, 5), codebook = normal(k, dim, 6);
  Result host = poisoned(n), got = poisoned(n);
  assign_nearest(points.data(), n, dim, codebook.data(), k, 0, nullptr, host.labels.data(),
                 host.sq_dist.data());
  assign_nearest(points.data(), n, dim, codebook.data(), k, {0, &device}, nullptr,
                 got.labels.data(), got.sq_dist.data());
  expect_equal(host, got);
  EXPECT_EQ(device.count, 1u);
}

// Seeding adds codewords to points that stay; iterations then replace all of them.
TEST_F(DeviceNearest, PointsThatStayAreSearchedAlike) {
  for (const size_t dim : {size_t{4}, size_t{48}}) {
    SCOPED_TRACE(dim);
    Counting device;
    const size_t n = 120011;  // several slices of 4 MiB of the larger ones
    std::vector<float> points = normal(n, dim, 8);
    points[77 * dim] = std::numeric_limits<float>::quiet_NaN();
    const std::unique_ptr<NearestDevice::HeldPoints> held =
        device.hold(points.data(), n, dim, 1024);
    ASSERT_NE(held, nullptr);
    Result host = poisoned(n), got = poisoned(n);
    std::fill(host.sq_dist.begin(), host.sq_dist.end(), std::numeric_limits<float>::infinity());
    got = host;
    uint32_t first = 0;
    for (const size_t k : {size_t{3}, size_t{40}, size_t{900}}) {
      const std::vector<float> more = normal(k, dim, 40 + k);
      update_nearest(points.data(), n, dim, more.data(), k, first, 0, host.labels.data(),
                     host.sq_dist.data());
      update_nearest(points.data(), n, dim, more.data(), k, first, {1, &device, held.get()},
                     got.labels.data(), got.sq_dist.data());
      expect_equal(host, got);
      first += static_cast<uint32_t>(k);
    }
    const std::vector<float> codebook = normal(1024, dim, 9);
    host = got = poisoned(n);
    assign_nearest(points.data(), n, dim, codebook.data(), 1024, 0, nullptr, host.labels.data(),
                   host.sq_dist.data());
    assign_nearest(points.data(), n, dim, codebook.data(), 1024, {1, &device, held.get()}, nullptr,
                   got.labels.data(), got.sq_dist.data());
    expect_equal(host, got);
    EXPECT_EQ(device.count, 4u);
    // Those that are others come from the host.
    std::vector<float> others = normal(n / 2, dim, 10);
    host = got = poisoned(n / 2);
    assign_nearest(others.data(), n / 2, dim, codebook.data(), 1024, 0, nullptr, host.labels.data(),
                   host.sq_dist.data());
    assign_nearest(others.data(), n / 2, dim, codebook.data(), 1024, {1, &device, held.get()},
                   nullptr, got.labels.data(), got.sq_dist.data());
    expect_equal(host, got);
    EXPECT_EQ(device.count, 5u);
  }
}

TEST_F(DeviceNearest, SearchesSideBySide) {
  Counting device;
  const size_t n = 50021, dim = 4, k = 700;
  constexpr size_t kCallers = 12;  // more than the device has room for: the others have the host
  std::vector<Result> host(kCallers, poisoned(n)), got(kCallers, poisoned(n));
  std::vector<std::thread> callers;
  for (size_t c = 0; c < kCallers; ++c) {
    callers.emplace_back([&, c] {
      const std::vector<float> points = normal(n, dim, 100 + c), codebook = normal(k, dim, 200 + c);
      assign_nearest(points.data(), n, dim, codebook.data(), k, 1, nullptr, host[c].labels.data(),
                     host[c].sq_dist.data());
      for (int again = 0; again < 5; ++again) {
        got[c] = poisoned(n);
        assign_nearest(points.data(), n, dim, codebook.data(), k, {1, &device}, nullptr,
                       got[c].labels.data(), got[c].sq_dist.data());
      }
    });
  }
  for (std::thread& caller : callers) caller.join();
  for (size_t c = 0; c < kCallers; ++c) expect_equal(host[c], got[c]);
  EXPECT_GE(device.count, 5u);
}

TEST_F(DeviceNearest, LeavesWhatIsSmallToTheHost) {
  Counting device;
  const std::vector<float> points = normal(100, 4, 5), codebook = normal(8, 4, 6);
  Result got = poisoned(100);
  assign_nearest(points.data(), 100, 4, codebook.data(), 8, {1, &device}, nullptr,
                 got.labels.data(), got.sq_dist.data());
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
    for (const int threads : {1, 7}) {
      options.threads = threads;
      const Codebook got = train_codebook(points.data(), nullptr, n, dim, options);
      EXPECT_EQ(host.entries, got.entries);
      EXPECT_EQ(host.weighted_distortion, got.weighted_distortion);
    }
    EXPECT_GT(device.count, 6u);
    EXPECT_EQ(device.holds, 4u);  // a narrow sample and a wide one, twice
  }
}

// Few distinct points, weights of zero, and more codewords than points.
TEST_F(DeviceNearest, CodebooksOfOddPointsAreTheHosts) {
  const size_t n = 40000, dim = 12;
  const std::vector<float> few = normal(300, dim, 11), any = normal(n, dim, 12);
  std::vector<float> repeated(n * dim), weights(n), zeros(n, 0.0f);
  Random random(13);
  for (size_t i = 0; i < n; ++i) {
    std::copy_n(few.data() + random.below(300) * dim, dim, repeated.data() + i * dim);
    weights[i] = i % 3 == 0 ? 0.0f : static_cast<float>(random.uniform());
  }
  Counting device;
  const auto compare = [&](const std::vector<float>& points, const std::vector<float>& w,
                           size_t count, size_t codewords) {
    KMeansOptions options;
    options.num_codewords = codewords;
    options.seed = 5;
    const Codebook host = train_codebook(points.data(), w.data(), count, dim, options);
    options.device = &device;
    const Codebook got = train_codebook(points.data(), w.data(), count, dim, options);
    EXPECT_EQ(host.entries, got.entries);
    EXPECT_EQ(host.weighted_distortion, got.weighted_distortion);
    return got.size();
  };
  EXPECT_EQ(compare(repeated, weights, n, 1024), 300u);
  EXPECT_GT(compare(any, weights, n, 2048), 2000u);
  EXPECT_GT(compare(any, zeros, n, 512), 500u);
  EXPECT_EQ(compare(any, weights, 3000, 4096), 2000u);  // of positive weight
  EXPECT_GT(device.count, 10u);
}

TEST_F(DeviceNearest, FilesAreTheHosts) {
  test::SceneOptions s;
  s.count = 20000;
  s.sh_degree = 3;
  const test::TestScene scene = test::make_scene(s);
  for (const char* preset : {"indexed", "paper-small", "default"}) {
    Bytes first, files[2];
    for (const uint32_t backend : {L4D_BACKEND_CPU, L4D_BACKEND_CUDA}) {
      for (const uint32_t threads : {7u, 1u}) {
        l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
        options.backend = backend;
        options.threads = threads;
        EncoderHandle e(&options);
        e.check(l4d_encoder_set_preset(e.get(), preset));
        e.check(l4d_encoder_set(e.get(), L4D_ENC_PRUNE_WEIGHT, -1));
        const l4d_gaussians view = scene.view();
        e.check(l4d_encoder_set_scene(e.get(), &view, &scene.timeline, nullptr));
        files[backend == L4D_BACKEND_CUDA] = e.encode();
        if (first.empty()) first = files[0];
        EXPECT_EQ(first, files[backend == L4D_BACKEND_CUDA])
            << preset << ", " << threads << " threads, backend " << backend;
      }
    }
  }
}

}  // namespace
}  // namespace l4d
