// SPDX-License-Identifier: Apache-2.0
// The fast path against the reference, through the C API.
#include "render/cpu/fast/fast.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <string>
#include <vector>

#include "render/cpu/reference.h"
#include "render/frame/scene.h"
#include "tests/render/judge.h"
#include "tests/render/scenes.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

using test::Random;

constexpr double kStep = 1.0 / 255;

struct Largest {
  double accurate = 0, fast_exponential = 0;
};

// All pixels of all cameras lie within `bound` of the reference; with the fast exponential those
// that do not are accounted for.
Largest compare(const std::string& name, const io::Scene& scene,
                const std::vector<l4d_camera>& cameras, const std::vector<double>& times,
                const float* background = nullptr, double bound = kStep) {
  const RendererHandle reference = make_renderer(L4D_BACKEND_REFERENCE);
  const RendererHandle fast = make_renderer(L4D_BACKEND_CPU);
  const RendererHandle quick = make_renderer(L4D_BACKEND_CPU, 2, L4D_RENDER_EXP_FAST);
  Largest largest;
  const l4d_gaussians gaussians = scene.view();
  for (const RendererHandle* r : {&reference, &fast, &quick}) {
    r->check(l4d_renderer_set_gaussians(r->get(), &gaussians, &scene.timeline));
    if (background != nullptr) r->check(l4d_renderer_set_background(r->get(), background));
  }
  for (const double time : times) {
    for (const RendererHandle* r : {&reference, &fast, &quick}) {
      r->check(l4d_renderer_set_time(r->get(), time));
    }
    for (const l4d_camera& camera : cameras) {
      const TestImage expected = render_both(reference, camera);
      const TestImage image = render_both(fast, camera), quick_image = render_both(quick, camera);
      EXPECT_EQ(expected.stats.visible, image.stats.visible);
      const double difference = largest_difference(expected.rgb, image.rgb);
      largest.accurate = std::max(largest.accurate, difference);
      EXPECT_LE(difference, bound) << name << ", " << camera.width << "x" << camera.height;
      // One faint splat more or less is a step of its own.
      EXPECT_LE(largest_difference(expected.alpha, image.alpha), 1.01 * bound) << name;
      largest.fast_exponential =
          std::max(largest.fast_exponential, largest_difference(expected.rgb, quick_image.rgb));
      if (background != nullptr) continue;
      Scene prepared;
      EXPECT_TRUE(prepared.prepare(gaussians, scene.timeline, 1, unlimited()).ok());
      Frame<float> frame;
      Frame<double> wide;
      EXPECT_TRUE(prepared.slice(time, 1, unlimited(), &frame).ok());
      EXPECT_TRUE(prepared.slice(time, unlimited(), &wide).ok());
      const Judge judge(frame, wide, camera, true);
      for (size_t k = 0; k < expected.rgb.size(); ++k) {
        const double d = std::fabs(static_cast<double>(expected.rgb[k] - quick_image.rgb[k]));
        if (d <= bound) continue;
        const size_t p = k / 3;
        const Verdict v =
            judge.judge(static_cast<int>(p % camera.width), static_cast<int>(p / camera.width),
                        &quick_image.rgb[3 * p], 1e-4);
        EXPECT_TRUE(v.explained) << name << ", pixel " << p << ": " << d << ", left " << v.left;
      }
    }
  }
  std::cout << name << ": largest difference " << largest.accurate << ", fast exponential "
            << largest.fast_exponential << "\n";
  return largest;
}

l4d_camera off_center(l4d_camera camera) {
  camera.cx = -0.2 * camera.width;
  camera.cy = 0.9 * camera.height;
  camera.fx *= 1.3;
  return camera;
}

TEST(Fast, SyntheticScenesOfEveryDegree) {
  const io::Scene scene = synth(12000);
  ASSERT_EQ(scene.sh_degree, 3u);
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    compare("degree " + std::to_string(degree), with_degree(scene, degree),
            {ring_camera(161, 97, 0.3), ring_camera(17, 5, 2), ring_camera(1, 1, 4),
             off_center(ring_camera(80, 112, 5))},
            {0.5, 3.1});
  }
}

TEST(Fast, LargerImageAndCameraInsideTheScene) {
  const io::Scene scene = synth(12000, 2);
  const double eye[3] = {0.3, -0.6, 0.2}, target[3] = {1, -0.5, 2};
  compare("640x360", scene, {ring_camera(640, 360, 1)}, {1.5});
  compare("inside", scene, {call_on(250, 131, 120, eye, target)}, {0, 4});
}

TEST(Fast, EachEffectAlone) {
  for (const char* effect : io::kSynthEffects) {
    io::SynthOptions options;
    options.gaussians = 3000;
    options.seconds = 2;
    options.effects = {effect};
    const io::Scene scene = io::synthesize(options);
    if (scene.count() > 0) compare(effect, scene, {ring_camera(90, 70, 0.7)}, {0.3, 1.9});
  }
}

TEST(Fast, BackgroundShinesThrough) {
  const float background[3] = {0.25f, 2.0f, 0.5f};
  compare("background", with_degree(synth(3000), 1), {ring_camera(75, 50, 2.5)}, {1}, background);
  RendererHandle empty = make_renderer(L4D_BACKEND_CPU);
  const io::Scene nothing = SceneBuilder().scene();
  empty.set_gaussians(nothing.view(), nothing.timeline);
  empty.check(l4d_renderer_set_background(empty.get(), background));
  empty.set_time(0);
  const TestImage image = render_both(empty, axis_camera(19, 7, 10));
  for (size_t k = 0; k < image.rgb.size(); ++k) EXPECT_EQ(image.rgb[k], background[k % 3]);
  for (const float a : image.alpha) EXPECT_EQ(a, 0);
  EXPECT_EQ(image.stats.projected, 0u);
}

io::Scene random_blobs(size_t count, double low, double high, double opacity_from, double speed) {
  Random random(9);
  SceneBuilder builder(1);
  for (size_t i = 0; i < count; ++i) {
    const double rgb[3] = {random.uniform(-0.2, 1), random.uniform(), random.uniform()};
    const double scale[3] = {random.uniform(low, high), random.uniform(low, high),
                             random.uniform(low, high)};
    builder.turn(builder.add(random.normal(), random.normal(), random.normal(), scale,
                             random.uniform(opacity_from, 1), rgb),
                 random, speed);
  }
  return builder.scene();
}

TEST(Fast, CameraAmongLargeGaussians) {
  compare("among Gaussians", random_blobs(1500, -4, 0, 0.01, 0.1),
          {axis_camera(200, 150, 180), axis_camera(133, 217, 60)}, {0.7});
}

TEST(Fast, NearPlane) {
  Random random(4);
  SceneBuilder builder;
  for (int i = 0; i < 400; ++i) {
    const double rgb[3] = {random.uniform(), random.uniform(), random.uniform()};
    builder.add_ball(0.1 * random.normal(), 0.1 * random.normal(), random.uniform(-0.02, 0.1),
                     std::exp(random.uniform(-7, -2)), random.uniform(0.01, 1), rgb);
  }
  l4d_camera far_plane = axis_camera(120, 80, 100);
  far_plane.near_plane = 0.05;
  compare("near plane", builder.scene(), {axis_camera(120, 80, 100), far_plane}, {0});
}

TEST(Fast, OpaqueGaussiansAndTheCut) {
  Random random(5);
  SceneBuilder builder;
  for (int i = 0; i < 300; ++i) {
    const double rgb[3] = {random.uniform(), random.uniform(), random.uniform()};
    builder.add_ball(random.normal(), random.normal(), 3 + 0.002 * i, 0.3, 1, rgb);
  }
  compare("opaque", builder.scene(), {axis_camera(200, 150, 180)}, {0});
}

// Thousands in one place: the same depth, order and pixels, until the pixels are done.
TEST(Fast, CoincidentGaussians) {
  Random random(6);
  SceneBuilder builder;
  for (int i = 0; i < 5000; ++i) {
    const double rgb[3] = {random.uniform(), random.uniform(), random.uniform()};
    builder.add_ball(0.1, -0.1, 4, 0.3, random.uniform(0.005, 0.03), rgb);
  }
  compare("coincident", builder.scene(), {axis_camera(100, 75, 90)}, {0});
}

// Equal depths blend in the order of the scene, over more than one part of the sorter.
TEST(Fast, EqualDepthsBlendInOrder) {
  SceneBuilder builder;
  const double red[3] = {1, 0, 0}, green[3] = {0, 1, 0}, nothing[3] = {0, 0, 0};
  builder.add_ball(0, 0, 4, 1, 0.9, red);
  for (int i = 0; i < 6000; ++i) builder.add_ball(100, 0, 4, 0.01, 0.5, nothing);
  builder.add_ball(0, 0, 4, 1, 0.9, green);
  RendererHandle renderer = make_renderer(L4D_BACKEND_CPU);
  renderer.set_gaussians(builder.scene().view(), builder.scene().timeline);
  renderer.set_time(0);
  const TestImage image = render_both(renderer, axis_camera(32, 32, 30));
  const size_t center = 16 * 32 + 16;
  EXPECT_GT(image.rgb[3 * center], 0.85f);
  EXPECT_LT(image.rgb[3 * center + 1], 0.1f);
  EXPECT_GT(image.rgb[3 * center + 1], 0.05f);
}

io::Scene needles(double ratio, double length) {
  Random random(7);
  SceneBuilder builder;
  for (int i = 0; i < 200; ++i) {
    const double rgb[3] = {random.uniform(), random.uniform(), random.uniform()};
    const double thin = std::log(length / ratio), scale[3] = {std::log(length), thin, thin};
    builder.turn(builder.add(random.normal(), random.normal(), 5 + random.normal(), scale,
                             random.uniform(0.2, 1), rgb),
                 random);
  }
  return builder.scene();
}

// A needle of L pixels and the dilation's half pixel: in binary32 its covariance is known to
// 2^-24 L^2 / 0.3 of its width, which is what these images show.
TEST(Fast, Needles) {
  for (const double ratio : {1e2, 1e4, 1e6}) {
    for (const double length : {0.2, 1.0}) {
      compare("needles 1:" + std::to_string(static_cast<int>(ratio)), needles(ratio, length),
              {axis_camera(200, 150, 180)}, {0});
    }
  }
  // 240 pixels and more.
  compare("long needles", needles(1e6, 1), {axis_camera(1000, 700, 1200)}, {0}, nullptr, 0.02);
}

TEST(Fast, ThreadsDoNotChangeBits) {
  const io::Scene scene = synth(20000, 3);
  for (const uint32_t exponential : {L4D_RENDER_EXP_ACCURATE, L4D_RENDER_EXP_FAST}) {
    TestImage first;
    for (const uint32_t threads : {1u, 2u, 7u}) {
      RendererHandle r = make_renderer(L4D_BACKEND_CPU, threads, exponential);
      r.set_gaussians(scene.view(), scene.timeline);
      r.set_time(1.7);
      const TestImage image = render_both(r, ring_camera(333, 217, 1));
      if (threads == 1) {
        first = image;
        continue;
      }
      EXPECT_TRUE(equal_bits(first.rgb, image.rgb)) << threads;
      EXPECT_TRUE(equal_bits(first.alpha, image.alpha)) << threads;
      EXPECT_EQ(first.stats.instances, image.stats.instances);
    }
  }
}

// What an earlier view left behind does not show, and either output may be absent.
TEST(Fast, ViewsAreIndependent) {
  const io::Scene scene = synth(8000, 4);
  RendererHandle r = make_renderer(L4D_BACKEND_CPU);
  r.set_gaussians(scene.view(), scene.timeline);
  r.set_time(1);
  const l4d_camera small = ring_camera(41, 23, 1), large = ring_camera(333, 217, 3);
  const TestImage before = render_both(r, small);
  render_both(r, large);
  const TestImage after = render_both(r, small);
  EXPECT_TRUE(equal_bits(before.rgb, after.rgb));
  EXPECT_EQ(before.stats.projected, after.stats.projected);
  EXPECT_GT(before.stats.instances, before.stats.projected / 2);
  EXPECT_TRUE(equal_bits(before.rgb, r.render(small)));
  std::vector<float> alpha(before.alpha.size());
  l4d_image image = L4D_INIT(l4d_image);
  image.alpha = alpha.data();
  r.check(l4d_renderer_render(r.get(), &small, &image));
  EXPECT_TRUE(equal_bits(before.alpha, alpha));
}

// The judge does not explain away what is wrong.
TEST(Fast, WrongPixelsAreNotExplained) {
  const io::Scene scene = synth(1000, 6);
  Scene prepared;
  ASSERT_TRUE(prepared.prepare(scene.view(), scene.timeline, 1, unlimited()).ok());
  Frame<float> frame;
  Frame<double> wide;
  EXPECT_TRUE(prepared.slice(1, 1, unlimited(), &frame).ok());
  EXPECT_TRUE(prepared.slice(1, unlimited(), &wide).ok());
  const l4d_camera camera = ring_camera(50, 40, 2);
  RendererHandle r = make_renderer(L4D_BACKEND_CPU);
  r.set_gaussians(scene.view(), scene.timeline);
  r.set_time(1);
  const std::vector<float> rgb = r.render(camera);
  const Judge right(frame, wide, camera, false);
  // One of the frames has a Gaussian less, or another order.
  Frame<float> faint = frame, nearer = frame;
  for (size_t i = 0; i < frame.count(); i += 5) faint.opacity[i] = 0;
  for (size_t i = 0; i < frame.count(); i += 2) {
    for (size_t k = 0; k < 3; ++k) nearer.position[k][i] *= 1.02f;
  }
  const Judge missing(faint, wide, camera, false), moved(nearer, wide, camera, false);
  size_t left_out = 0, swapped = 0;
  for (int y = 0; y < 40; y += 4) {
    for (int x = 0; x < 50; x += 4) {
      float pixel[3];
      std::copy_n(&rgb[static_cast<size_t>(3 * (50 * y + x))], 3, pixel);
      const Verdict v = right.judge(x, y, pixel, 0);
      EXPECT_LE(v.left, kStep);
      pixel[1] += 0.01f;
      EXPECT_FALSE(right.judge(x, y, pixel, 0).explained);
      const Verdict without = missing.judge(x, y, &rgb[static_cast<size_t>(3 * (50 * y + x))], 0);
      left_out += without.skips > 0 && !without.explained;
      const Verdict other = moved.judge(x, y, &rgb[static_cast<size_t>(3 * (50 * y + x))], 0);
      swapped += other.swaps > 0 && !other.explained;
    }
  }
  EXPECT_GT(left_out, 30u);
  EXPECT_GT(swapped, 5u);
}

// The frame of an instant, without what slicing rounds.
TEST(Fast, RasterizersOnOneFrame) {
  const io::Scene scene = synth(12000, 5);
  Scene prepared;
  ASSERT_TRUE(prepared.prepare(scene.view(), scene.timeline, 2, unlimited()).ok());
  Frame<float> frame;
  Frame<double> wide;
  EXPECT_TRUE(prepared.slice(2.2, 2, unlimited(), &frame).ok());
  EXPECT_TRUE(widen(frame, unlimited(), &wide).ok());
  const float background[3] = {0.1f, 0.2f, 0.3f};
  const l4d_camera camera = ring_camera(201, 133, 2);
  const size_t pixels = size_t{201} * 133;
  std::vector<float> rgb(3 * pixels), expected(3 * pixels), alpha(pixels), expected_alpha(pixels);
  Stats stats, reference_stats;
  EXPECT_TRUE(
      make_fast_rasterizer(2, false, unlimited())
          ->forward(frame, make_view<float>(camera), background, rgb.data(), alpha.data(), &stats)
          .ok());
  EXPECT_TRUE(make_reference_rasterizer(unlimited())
                  ->forward(wide, make_view<double>(camera), background, expected.data(),
                            expected_alpha.data(), &reference_stats)
                  .ok());
  EXPECT_LE(largest_difference(rgb, expected), kStep);
  EXPECT_LE(largest_difference(alpha, expected_alpha), kStep);
  EXPECT_NEAR(static_cast<double>(stats.projected), static_cast<double>(reference_stats.projected),
              2);
}

}  // namespace
}  // namespace l4d::render
