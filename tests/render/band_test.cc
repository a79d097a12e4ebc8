// SPDX-License-Identifier: Apache-2.0
// Views whose pairs of splat and tile do not fit in memory: made band by band, with the same bits.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "l4d/experimental/sensitivity.hpp"
#include "render/cpu/fast/bins.h"
#include "tests/common/random.h"
#include "tests/decoder/allocation_meter.h"
#include "tests/render/scenes.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

using test::AllocationMeter;
using test::Random;

constexpr uint64_t kMiB = uint64_t{1} << 20;
constexpr uint32_t kWidth = 333, kHeight = 217;

// Faint veils that each cover most of the image, and some small ones among them.
io::Scene veils(size_t count) {
  Random random(5);
  SceneBuilder builder(1);
  for (size_t i = 0; i < count; ++i) {
    const double rgb[3] = {random.uniform(), random.uniform(), random.uniform()};
    const double sigma = i % 8 == 0 ? 0.05 : random.uniform(1, 4);
    const size_t at =
        builder.add_ball(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(2, 6), sigma,
                         random.uniform(0.006, i % 8 == 0 ? 0.9 : 0.02), rgb);
    builder.turn(at, random, i % 5 == 0 ? 0.01 : 0);
  }
  return builder.scene();
}

RendererHandle renderer(uint64_t memory, uint32_t threads, uint32_t path = L4D_BACKEND_CPU) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.max_memory_bytes = memory;
  options.threads = threads;
  options.backend = path;
  return RendererHandle(&options);
}

// All that a renderer makes of a view, and the most it held for it.
struct Results {
  l4d_status status = L4D_OK;
  std::string detail;
  std::vector<float> rgb, alpha;
  std::vector<float> position, mean_t, log_scale, rotor, opacity, sh;
  std::vector<float> weights[4], coverage;
  uint64_t instances = 0;
  uint64_t forward_peak = 0, peak = 0;
};

Results results_of(const io::Scene& scene, uint64_t memory, uint32_t threads = 2) {
  const l4d_camera camera = axis_camera(kWidth, kHeight, 300);
  const size_t pixels = size_t{kWidth} * kHeight, n = scene.count();
  Results out;
  out.rgb.resize(3 * pixels);
  out.alpha.resize(pixels);
  out.position.resize(3 * n);
  out.mean_t.resize(n);
  out.log_scale.resize(4 * n);
  out.rotor.resize(8 * n);
  out.opacity.resize(n);
  out.sh.resize(scene.sh.size());
  std::vector<float> upstream(3 * pixels);
  for (size_t k = 0; k < upstream.size(); ++k) upstream[k] = std::sin(0.1f * static_cast<float>(k));
  const l4d_gaussians view = scene.view();
  l4d_image image = L4D_INIT(l4d_image);
  image.rgb = out.rgb.data();
  image.alpha = out.alpha.data();
  l4d_gradients gradients = L4D_INIT(l4d_gradients);
  gradients.count = n;
  gradients.position = out.position.data();
  gradients.mean_t = out.mean_t.data();
  gradients.log_scale = out.log_scale.data();
  gradients.rotor = out.rotor.data();
  gradients.opacity = out.opacity.data();
  gradients.sh = out.sh.data();
  const RendererHandle r = renderer(memory, threads);
  const auto step = [&](l4d_status status) {
    if (out.status == L4D_OK && status != L4D_OK) out.detail = l4d_last_error_message();
    if (out.status == L4D_OK) out.status = status;
    return out.status == L4D_OK;
  };
  const AllocationMeter meter;
  step(l4d_renderer_set_gaussians(r.get(), &view, &scene.timeline));
  if (out.status == L4D_OK) step(l4d_renderer_set_time(r.get(), 1));
  if (out.status == L4D_OK) step(l4d_renderer_render(r.get(), &camera, &image));
  out.forward_peak = meter.peak();
  if (out.status == L4D_OK) out.instances = r.stats().instances;
  if (out.status == L4D_OK) {
    step(l4d_renderer_backward(r.get(), &camera, upstream.data(), &gradients));
  }
  out.peak = meter.peak();
  if (out.status != L4D_OK) return out;
  for (const uint32_t metric : {L4D_SENSITIVITY_SUM, L4D_SENSITIVITY_GAUSS_NEWTON}) {
    l4d_sensitivity_options options = L4D_INIT(l4d_sensitivity_options);
    options.metric = metric;
    SensitivityHandle sums(&options, n, scene.sh_degree);
    sums.add_view(r, camera, true);
    sums.add_view(r, camera);
    for (const uint32_t which : {L4D_WEIGHT_ALPHA_T, L4D_WEIGHT_POSITION}) {
      std::vector<float>& weights = out.weights[2 * metric + (which == L4D_WEIGHT_POSITION)];
      weights.resize(n);
      EXPECT_EQ(l4d_sensitivity_get_weights(sums.get(), which, weights.data(), n), L4D_OK);
    }
  }
  return out;
}

void expect_same(const Results& a, const Results& b) {
  EXPECT_EQ(a.rgb, b.rgb);
  EXPECT_EQ(a.alpha, b.alpha);
  EXPECT_EQ(a.position, b.position);
  EXPECT_EQ(a.mean_t, b.mean_t);
  EXPECT_EQ(a.log_scale, b.log_scale);
  EXPECT_EQ(a.rotor, b.rotor);
  EXPECT_EQ(a.opacity, b.opacity);
  EXPECT_EQ(a.sh, b.sh);
  for (size_t k = 0; k < 4; ++k) EXPECT_EQ(a.weights[k], b.weights[k]);
  EXPECT_EQ(a.instances, b.instances);
}

// From what holds all of it in one band to what holds a part of a row of tiles.
TEST(Bands, LimitsChangeNoBit) {
  const io::Scene scene = veils(3000);
  const Results all = results_of(scene, 0);
  ASSERT_EQ(all.status, L4D_OK) << all.detail;
  ASSERT_GT(all.instances, 500000u);
  EXPECT_GT(all.peak, 20 * kMiB);
  for (const uint64_t limit : {12 * kMiB, 3 * kMiB, 3 * kMiB / 2}) {
    for (const uint32_t threads : {1u, 5u}) {
#ifdef L4D_SANITIZED
      // Bits are compared without sanitizers, too, which look at each limit once.
      if ((threads == 1) != (limit == 3 * kMiB)) continue;
#endif
      const Results within = results_of(scene, limit, threads);
      ASSERT_EQ(within.status, L4D_OK) << within.detail;
      expect_same(all, within);
      std::printf("limit %llu: held %llu, %llu of it to render\n",
                  static_cast<unsigned long long>(limit),
                  static_cast<unsigned long long>(within.peak),
                  static_cast<unsigned long long>(within.forward_peak));
      // Threads and small things of a call are not counted.
      EXPECT_LT(within.peak, limit + kMiB / 4);
    }
  }
}

// Where even the splats do not fit, the call says so, and the next one works.
TEST(Bands, RefusesWhatDoesNotFit) {
  const io::Scene scene = veils(1500);
  uint64_t refused = 0;
  for (uint64_t limit = kMiB / 32; limit < 3 * kMiB / 4; limit += kMiB / 32) {
    const Results within = results_of(scene, limit, 1);
    if (within.status == L4D_OK) continue;
    ++refused;
    EXPECT_EQ(within.status, L4D_ERR_LIMIT_EXCEEDED);
    EXPECT_NE(within.detail.find("the limit is " + std::to_string(limit)), std::string::npos)
        << within.detail;
    EXPECT_LT(within.peak, limit + kMiB / 4);
  }
  EXPECT_GT(refused, 8u);
  RendererHandle r = renderer(5 * kMiB / 4, 1);
  const io::Scene many = veils(8000);
  const l4d_gaussians large = many.view();
  EXPECT_EQ(l4d_renderer_set_gaussians(r.get(), &large, &many.timeline), L4D_OK);
  EXPECT_EQ(l4d_renderer_set_time(r.get(), 1), L4D_OK);
  const l4d_camera camera = axis_camera(kWidth, kHeight, 300);
  std::vector<float> rgb(size_t{3} * kWidth * kHeight);
  EXPECT_THROW(r.render(camera, rgb.data()), Error);
  const io::Scene small = veils(100);
  r.set_gaussians(small.view(), small.timeline);
  r.set_time(1);
  r.render(camera, rgb.data());
  std::vector<float> expected(rgb.size());
  RendererHandle other = renderer(0, 1);
  other.set_gaussians(small.view(), small.timeline);
  other.set_time(1);
  other.render(camera, expected.data());
  EXPECT_EQ(rgb, expected);
}

TEST(Bands, TheReferenceHoldsItsLimitToo) {
  const io::Scene scene = veils(300);
  const l4d_camera camera = axis_camera(64, 48, 60);
  for (const uint64_t limit : {uint64_t{100000}, kMiB}) {
    RendererHandle r = renderer(limit, 1, L4D_BACKEND_REFERENCE);
    std::vector<float> rgb(size_t{3} * 64 * 48);
    l4d_image image = L4D_INIT(l4d_image);
    image.rgb = rgb.data();
    const AllocationMeter meter;
    r.set_gaussians(scene.view(), scene.timeline);
    r.set_time(1);
    const l4d_status status = l4d_renderer_render(r.get(), &camera, &image);
    EXPECT_EQ(status, limit < kMiB ? L4D_ERR_LIMIT_EXCEEDED : L4D_OK);
    EXPECT_LT(meter.peak(), limit + 20000);
  }
}

// A tile has one list, whatever band it is made in.
TEST(Bands, ListsAreThoseOfTheWholeImage) {
  Random random(9);
  std::vector<FastSplat> splats(20000);
  for (FastSplat& s : splats) {
    const float size = std::exp(random.uniformf(0, 6));
    s.mean[0] = random.uniformf(-50, 350);
    s.mean[1] = random.uniformf(-50, 250);
    s.extent[0] = size;
    s.extent[1] = 0.5f * size;
    // extent^2 = 2 ln(255 opacity) covariance, the covariance diagonal.
    s.opacity = 0.5f;
    s.log2_opacity = -1;
    s.log2_least = kLog2MinAlpha;
    s.conic[0] = -(s.log2_opacity - kLog2MinAlpha) / (s.extent[0] * s.extent[0]);
    s.conic[1] = 0;
    s.conic[2] = -(s.log2_opacity - kLog2MinAlpha) / (s.extent[1] * s.extent[1]);
  }
  MemoryBudget memory;
  TileBins whole, cut;
  ASSERT_TRUE(whole.start(splats, 300, 200, 2, memory).ok());
  ASSERT_TRUE(whole.build(splats, whole.whole(), true, 2, memory).ok());
  ASSERT_TRUE(cut.start(splats, 300, 200, 2, memory).ok());
  size_t most = 0;
  for (const uint64_t bytes : {4 * kMiB, kMiB, kMiB / 8, uint64_t{1}}) {
    std::vector<Band> bands;
    ASSERT_TRUE(cut.cut(bytes, 0, true, memory, &bands).ok());
    EXPECT_GT(bands.size(), most);
    most = bands.size();
    size_t tiles = 0, instances = 0;
    for (const Band& band : bands) {
      ASSERT_TRUE(cut.build(splats, band, true, 2, memory).ok());
      EXPECT_TRUE(cut.instances() * 8 <= bytes || band.tiles() == 1);
      for (size_t t = 0; t < band.tiles(); ++t) {
        const size_t columns = static_cast<size_t>(band.columns());
        const size_t row = static_cast<size_t>(band.row_begin) + t / columns;
        const size_t column = static_cast<size_t>(band.column_begin) + t % columns;
        const size_t tile = row * static_cast<size_t>(whole.columns()) + column;
        EXPECT_EQ(tile, tiles++) << "bands follow each other as tiles do";
        ASSERT_EQ(cut.count(t), whole.count(tile));
        ASSERT_TRUE(std::equal(cut.list(t), cut.list(t) + cut.count(t), whole.list(tile)));
      }
      for (size_t i = 0; i < splats.size(); ++i) {
        for (size_t e = cut.emitted(i); e < cut.emitted(i + 1); ++e) {
          ASSERT_EQ(cut.list(0)[cut.place(e)], i);
          ++instances;
        }
      }
    }
    EXPECT_EQ(tiles, whole.whole().tiles());
    EXPECT_EQ(instances, whole.instances());
  }
  EXPECT_EQ(most, whole.whole().tiles());
}

}  // namespace
}  // namespace l4d::render
