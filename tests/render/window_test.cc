// SPDX-License-Identifier: Apache-2.0
// Flat windows in the slices of renderers, and in derivatives.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "render/frame/scene.h"
#include "render/frame/slice_gradient.h"
#include "tests/common/test_scene.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

using namespace l4d::test;

TestScene windowed_scene() {
  SceneOptions o;
  o.count = 600;
  TestScene scene = make_scene(o);
  for (uint32_t i = 0; i < scene.count(); ++i) {
    const uint32_t begin = i % 60;
    const bool flat = i % 3 != 0;
    scene.window.push_back(flat ? begin : 0);
    scene.window.push_back(flat ? std::min(60u, begin + 1 + i % 4) : 0);
  }
  return scene;
}

TEST(Windows, FramesShowWhatIsOpen) {
  const TestScene scene = windowed_scene();
  Scene prepared;
  ASSERT_TRUE(prepared.prepare(scene.view(), scene.timeline, 2, unlimited()).ok());
  for (uint32_t k = 0; k < 60; ++k) {
    for (const double part : {0.0, 0.7}) {
      const double time = (k + part) / 30;
      Frame<float> frame;
      Frame<double> wide;
      ASSERT_TRUE(prepared.slice(time, 2, unlimited(), &frame).ok());
      ASSERT_TRUE(prepared.slice(time, unlimited(), &wide).ok());
      ASSERT_EQ(frame.id, wide.id);
      std::vector<bool> listed(scene.count());
      for (size_t j = 0; j < frame.count(); ++j) {
        const size_t i = frame.id[j];
        listed[i] = true;
        if (scene.window[2 * i + 1] == 0) continue;
        EXPECT_EQ(frame.opacity[j], scene.opacity[i]);
        EXPECT_EQ(wide.opacity[j], static_cast<double>(scene.opacity[i]));
      }
      for (size_t i = 0; i < scene.count(); ++i) {
        if (scene.window[2 * i + 1] == 0) continue;
        const bool open = scene.window[2 * i] <= k && k < scene.window[2 * i + 1];
        ASSERT_EQ(listed[i], open) << i << " in frame " << k;
      }
    }
  }
}

TEST(Windows, InvalidOnesAreRefused) {
  for (const uint32_t end : {3u, 2u, 61u}) {
    TestScene scene = windowed_scene();
    scene.window[2] = 3;
    scene.window[3] = end;
    Scene prepared;
    EXPECT_EQ(prepared.prepare(scene.view(), scene.timeline, 1, unlimited()).code(),
              L4D_ERR_INVALID_SCENE);
  }
}

// Opacity does not change with time, so nothing of it is derived by mean times or extents.
TEST(Windows, DerivativesSeeNoFalloff) {
  TestScene scene = windowed_scene();
  const l4d_gaussians g = scene.view();
  const Gaussian4D<double> one = read_gaussian<double>(g, 1, 0.0);
  ASSERT_TRUE(one.flat);
  const Instant<double> instant{0.05, 0, 2, false, false};
  EXPECT_EQ(slice_at(one, instant).opacity, static_cast<double>(scene.opacity[1]));
  SplatGradient3D<double> by_opacity;
  by_opacity.opacity = 1;
  const Gradient4D<double> gradient = slice_gradient(one, instant, by_opacity);
  EXPECT_EQ(gradient.opacity, 1);
  EXPECT_EQ(gradient.mean_t, 0);
  for (const double v : gradient.log_scale) EXPECT_EQ(v, 0);
  for (const double v : gradient.rotor) EXPECT_EQ(v, 0);
}

}  // namespace
}  // namespace l4d::render
