// SPDX-License-Identifier: Apache-2.0
// The fast path against the reference on a trained scene, pixel by pixel.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <iostream>
#include <thread>
#include <vector>

#include "io/camera/cameras.h"
#include "io/ply/scene_ply.h"
#include "render/cpu/fast/fast.h"
#include "render/cpu/reference.h"
#include "render/frame/scene.h"
#include "tests/common/files.h"
#include "tests/render/judge.h"
#include "tests/render/scenes.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

constexpr float kBlack[3] = {0, 0, 0};
constexpr double kStep = 1.0 / 255;

// What is found of one exponential.
struct Findings {
  size_t pixels = 0, beyond = 0, stops = 0, swaps = 0, skips = 0, unexplained = 0;
  double largest = 0, stop_distance = 0;

  void print(const char* name) const {
    std::cout << name << ": " << pixels << " pixels, largest difference " << largest << ", "
              << beyond << " beyond 1/255: stop rule " << stops << " (relative distance up to "
              << stop_distance << "), equal depth " << swaps << ", faint alpha " << skips
              << ", unexplained " << unexplained << "\n";
  }
};

void compare(const TestImage& fast, const TestImage& reference, const l4d_camera& camera,
             const Frame<float>& frame, const Frame<double>& wide, bool fast_exponential,
             Findings* found) {
  std::vector<size_t> beyond;
  for (size_t p = 0; p < fast.alpha.size(); ++p) {
    double difference = 0;
    for (size_t c = 0; c < 3; ++c) {
      difference = std::max(difference, std::fabs(static_cast<double>(fast.rgb[3 * p + c]) -
                                                  static_cast<double>(reference.rgb[3 * p + c])));
    }
    found->largest = std::max(found->largest, difference);
    if (!(difference <= kStep)) beyond.push_back(p);
  }
  found->pixels += fast.alpha.size();
  found->beyond += beyond.size();
  if (beyond.empty()) return;
  const Judge judge(frame, wide, camera, fast_exponential);
  for (const size_t p : beyond) {
    const int x = static_cast<int>(p % camera.width), y = static_cast<int>(p / camera.width);
    const Verdict v = judge.judge(x, y, &fast.rgb[3 * p], fast_exponential ? 1e-4 : 0);
    found->stops += v.stops > 0;
    found->swaps += v.swaps > 0;
    found->skips += v.skips > 0;
    found->stop_distance = std::max(found->stop_distance, v.stop_distance);
    found->unexplained += !v.explained;
    EXPECT_TRUE(v.explained) << "pixel " << x << ", " << y << ": stops " << v.stops << " at "
                             << v.stop_distance << ", swaps " << v.swaps << " at "
                             << v.swap_distance << ", skips " << v.skips << " at "
                             << v.skip_distance << ", left " << v.left;
  }
}

TEST(FastBasketball, EveryPixelOfTwentyViews) {
#ifdef L4D_SANITIZED
  GTEST_SKIP() << "a real scene is drawn without sanitizers";
#endif
  const std::string path = test::data_file("basketball/basketball.ply");
  if (path.empty()) GTEST_SKIP() << "no basketball scene: set L4D_DATA_DIR";
  const io::Scene scene = io::read_scene_ply(path);
  const io::CameraSet set = io::read_cameras(test::data_file("basketball/cameras.json"));
  const l4d_gaussians gaussians = scene.view();
  Scene prepared;
  ASSERT_TRUE(prepared.prepare(gaussians, scene.timeline, 2, unlimited()).ok());
  std::vector<l4d_camera> cameras;
  for (const size_t c : {0u, 7u, 15u, 22u, 30u}) cameras.push_back(set.cameras.at(c).camera);
  const auto accurate = make_fast_rasterizer(2, false, unlimited()),
             quick = make_fast_rasterizer(2, true, unlimited());

  Findings findings[2];
  for (const double time : {0.0, 1.3, 2.61, 4.9}) {
    Frame<float> frame;
    Frame<double> wide;
    EXPECT_TRUE(prepared.slice(time, 2, unlimited(), &frame).ok());
    EXPECT_TRUE(prepared.slice(time, unlimited(), &wide).ok());
    ASSERT_EQ(frame.id, wide.id);
    std::vector<TestImage> expected(cameras.size());
    const auto render_half = [&](size_t first) {
      for (size_t k = first; k < cameras.size(); k += 2) {
        const size_t pixels = size_t{cameras[k].width} * cameras[k].height;
        expected[k].rgb.resize(3 * pixels);
        EXPECT_TRUE(make_reference_rasterizer(unlimited())
                        ->forward(wide, make_view<double>(cameras[k]), kBlack,
                                  expected[k].rgb.data(), nullptr, nullptr)
                        .ok());
      }
    };
    std::thread other(render_half, 1);
    render_half(0);
    other.join();
    for (size_t k = 0; k < cameras.size(); ++k) {
      for (const bool fast_exponential : {false, true}) {
        TestImage image;
        image.rgb.resize(expected[k].rgb.size());
        image.alpha.resize(image.rgb.size() / 3);
        Stats stats;
        EXPECT_TRUE((fast_exponential ? quick : accurate)
                        ->forward(frame, make_view<float>(cameras[k]), kBlack, image.rgb.data(),
                                  image.alpha.data(), &stats)
                        .ok());
        EXPECT_GT(stats.projected, 40000u);
        compare(image, expected[k], cameras[k], frame, wide, fast_exponential,
                &findings[fast_exponential ? 1 : 0]);
      }
    }
  }
  findings[0].print("accurate exponential");
  findings[1].print("fast exponential");
  EXPECT_EQ(findings[0].pixels, size_t{20} * 640 * 360);
  // A few pixels in a million, none without the reason being shown.
  EXPECT_LE(findings[0].beyond, 20u);
  EXPECT_LE(findings[1].beyond, 200u);
  EXPECT_LT(findings[0].largest, 0.05);
  EXPECT_LT(findings[1].largest, 0.05);
}

}  // namespace
}  // namespace l4d::render
