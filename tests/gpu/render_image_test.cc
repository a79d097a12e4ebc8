// SPDX-License-Identifier: Apache-2.0
// Images of the device against those of the reference.
#include "l4d/encode.hpp"
#include "tests/gpu/render_support.h"

namespace l4d::render {
namespace {

using test::Random;

constexpr double kStep = 1.0 / 255;

struct Totals {
  size_t pixels = 0, beyond = 0;
  double largest = 0;
};

// Rounding decides about single pixels: where blending stops, which of two splats of one depth is
// in front. Of those that differ by more than a step of 8 bits there may be one in 20,000, and two.
void compare(const std::string& name, const io::Scene& scene,
             const std::vector<l4d_camera>& cameras, const std::vector<double>& times,
             uint32_t path = L4D_BACKEND_REFERENCE, const float* background = nullptr) {
  const RendererHandle expected = make_renderer(path), device = make_device();
  const l4d_gaussians gaussians = scene.view();
  for (const RendererHandle* r : {&expected, &device}) {
    r->check(l4d_renderer_set_gaussians(r->get(), &gaussians, &scene.timeline));
    if (background != nullptr) r->check(l4d_renderer_set_background(r->get(), background));
  }
  Totals totals;
  for (const double time : times) {
    expected.check(l4d_renderer_set_time(expected.get(), time));
    device.check(l4d_renderer_set_time(device.get(), time));
    for (const l4d_camera& camera : cameras) {
      const TestImage e = render_both(expected, camera), d = render_both(device, camera);
      EXPECT_EQ(e.stats.visible, d.stats.visible) << name;
      // Small ones between the centres of pixels touch no tile.
      EXPECT_LE(d.stats.projected, e.stats.projected + 2) << name;
      EXPECT_GE(static_cast<double>(d.stats.projected) + 2,
                0.98 * static_cast<double>(e.stats.projected))
          << name;
      const ImageDifference rgb = difference_of(d.rgb, e.rgb, kStep);
      totals.pixels += e.alpha.size();
      totals.beyond += rgb.beyond;
      totals.largest = std::max(totals.largest, rgb.largest);
      EXPECT_LE(largest_difference(d.alpha, e.alpha), 0.11) << name;
      // The same again, bit for bit.
      const TestImage again = render_both(device, camera);
      EXPECT_TRUE(equal_bits(d.rgb, again.rgb)) << name;
      EXPECT_TRUE(equal_bits(d.alpha, again.alpha)) << name;
    }
  }
  std::cout << name << ": " << totals.beyond << " of " << totals.pixels
            << " pixels differ by more than 1/255; largest difference " << totals.largest << "\n";
  EXPECT_LE(static_cast<double>(totals.beyond), 2 + static_cast<double>(totals.pixels) / 20000)
      << name;
  EXPECT_LE(totals.largest, 0.2) << name;
}

std::vector<l4d_camera> ring(uint32_t width, uint32_t height) {
  return {ring_camera(width, height, 0.4), ring_camera(width, height, 2.5, 3),
          ring_camera(width, height, 4.4, 9)};
}

TEST(DeviceImage, EveryDegreeIsTheReference) {
  L4D_SKIP_WITHOUT_DEVICE();
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    compare("degree " + std::to_string(degree), with_degree(synth(20000), degree), ring(203, 151),
            {0.0, 1.3, 4.0});
  }
}

TEST(DeviceImage, LargeFrames) {
  L4D_SKIP_WITHOUT_DEVICE();
  const float background[3] = {0.3f, 0.6f, 0.1f};
  compare("1352x1014", synth(300000, 7), ring(1352, 1014), {2.2}, L4D_BACKEND_CPU, background);
}

TEST(DeviceImage, OddSizes) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(5000);
  for (const auto& size :
       {std::pair<uint32_t, uint32_t>{1, 1}, {1, 40}, {17, 1}, {16, 16}, {33, 31}}) {
    compare(std::to_string(size.first) + "x" + std::to_string(size.second), scene,
            ring(size.first, size.second), {0.7});
  }
}

TEST(DeviceImage, NothingToSee) {
  L4D_SKIP_WITHOUT_DEVICE();
  const float background[3] = {0.25f, 0.5f, 1.0f};
  const double rgb[3] = {1, 0, 0};
  io::Scene empty;
  empty.timeline = synth(10).timeline;
  SceneBuilder behind;
  behind.add_ball(0, 0, -3, 0.2, 0.9, rgb);
  SceneBuilder faint;
  faint.add_ball(0, 0, 3, 0.2, 0.003, rgb);
  for (const io::Scene& scene : {empty, behind.scene(), faint.scene()}) {
    const RendererHandle device = make_device();
    const l4d_gaussians gaussians = scene.view();
    device.check(l4d_renderer_set_gaussians(device.get(), &gaussians, &scene.timeline));
    device.check(l4d_renderer_set_background(device.get(), background));
    device.check(l4d_renderer_set_time(device.get(), 0.5));
    const TestImage image = render_both(device, axis_camera(50, 40, 60));
    EXPECT_EQ(image.stats.projected, 0u);
    for (size_t pixel = 0; pixel < image.alpha.size(); ++pixel) {
      ASSERT_EQ(image.alpha[pixel], 0.0f);
      for (size_t c = 0; c < 3; ++c) ASSERT_EQ(image.rgb[3 * pixel + c], background[c]);
    }
  }
}

TEST(DeviceImage, OneGaussianOverAll) {
  L4D_SKIP_WITHOUT_DEVICE();
  SceneBuilder builder(3);
  const double rgb[3] = {0.2, 0.9, 0.4};
  builder.add_ball(0, 0, 2, 3.0, 0.9, rgb);
  compare("one over all", builder.scene(), {axis_camera(700, 500, 400)}, {0.5});
}

TEST(DeviceImage, CamerasInsideTheScene) {
  L4D_SKIP_WITHOUT_DEVICE();
  const double eye[3] = {0.1, -0.4, 0.2}, target[3] = {1, -0.3, 0.7};
  compare("inside", synth(20000), {call_on(160, 120, 90, eye, target)}, {0.5, 2.0});
}

// A hundred thousand in one tile, most of them behind what is opaque, many at the very same depth:
// of those the order of the scene decides.
TEST(DeviceImage, OneCrowdedTile) {
  L4D_SKIP_WITHOUT_DEVICE();
  Random random(3);
  SceneBuilder builder;
  for (int i = 0; i < 100000; ++i) {
    const double rgb[3] = {random.uniform(0, 1), random.uniform(0, 1), random.uniform(0, 1)};
    const double z = 2 + 0.25 * static_cast<double>(i % 7);
    builder.add_ball(random.uniform(-0.02, 0.02), random.uniform(-0.02, 0.02), z, 0.004,
                     random.uniform(0.01, 0.05), rgb);
  }
  compare("crowded", builder.scene(), {axis_camera(48, 48, 300)}, {0.5});
}

TEST(DeviceImage, FadingAndMovingOnesAtTheirEnds) {
  L4D_SKIP_WITHOUT_DEVICE();
  Random random(9);
  SceneBuilder builder(1);
  for (int i = 0; i < 400; ++i) {
    const double rgb[3] = {random.uniform(0, 1), random.uniform(0, 1), random.uniform(0, 1)};
    const size_t at = builder.add_ball(random.normal(), random.normal(), 6 + random.normal(), 0.15,
                                       random.uniform(0.2, 0.95), rgb);
    if (i % 3 > 0) builder.scene().log_scale[4 * at + 3] = random.uniformf(-3, 1);
    builder.scene().mean_t[at] = random.uniformf(-1, 3);
    if (i % 3 > 1) builder.turn(at, random, 0.3);
  }
  compare("fading and moving", builder.scene(), {axis_camera(120, 90, 110)}, {0, 0.5, 1.1, 2.0});
}

// At the beginnings of frames, just before them, and between.
TEST(DeviceImage, FlatWindows) {
  L4D_SKIP_WITHOUT_DEVICE();
  const double frame = 1.0 / 30;
  compare("windows", with_windows(synth(20000)), ring(203, 151),
          {0, frame, 17 * frame, std::nextafter(17 * frame, 0.0), 17.999 * frame, 55.4 * frame, 4});
  io::Scene scene = with_windows(with_degree(synth(5000, 5), 1));
  io::opacity_to_logit(scene);
  io::positions_to_mean_time(scene);
  compare("windows, logits and mean times", scene, ring(120, 90), {0.3, 1.7});
}

// Windows of a scene leave nothing behind in the next one.
TEST(DeviceImage, ScenesWithAndWithoutWindows) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene without = synth(6000, 3), with = with_windows(without);
  const l4d_camera camera = ring_camera(160, 120, 0.9);
  RendererHandle device = make_device();
  for (const io::Scene* scene : {&with, &without, &with}) {
    RendererHandle expected = make_renderer(L4D_BACKEND_CPU);
    for (RendererHandle* r : {&device, &expected}) {
      r->set_gaussians(scene->view(), scene->timeline);
      r->set_time(1.1);
    }
    const ImageDifference d = difference_of(device.render(camera), expected.render(camera), kStep);
    EXPECT_LE(d.beyond, 2u);
    EXPECT_EQ(device.stats().visible, expected.stats().visible);
  }
}

void expect_streams_are_shown(const io::Scene& scene) {
  EncoderHandle encoder;
  const l4d_gaussians gaussians = scene.view();
  encoder.check(
      l4d_encoder_set_scene(encoder.get(), &gaussians, &scene.timeline, &scene.placement));
  const std::vector<unsigned char> file = encoder.encode();
  DecoderHandle first, second;
  first.open_memory(file.data(), file.size());
  second.open_memory(file.data(), file.size());
  RendererHandle expected = make_renderer(L4D_BACKEND_CPU), device = make_device();
  expected.set_decoder(first);
  device.set_decoder(second);
  for (const double time : {0.2, 1.9}) {
    expected.set_time(time);
    device.set_time(time);
    const l4d_camera camera = ring_camera(160, 120, 1.1);
    const ImageDifference d = difference_of(device.render(camera), expected.render(camera), kStep);
    EXPECT_LE(d.beyond, 2u);
    EXPECT_GT(device.stats().projected, 100u);
  }
}

TEST(DeviceImage, StreamsAreDecodedAndShown) {
  L4D_SKIP_WITHOUT_DEVICE();
  expect_streams_are_shown(synth(8000));
  expect_streams_are_shown(with_windows(synth(8000)));
}

TEST(DeviceImage, ArgumentsAreChecked) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.backend = L4D_BACKEND_CUDA + 1;
  l4d_renderer* renderer = nullptr;
  EXPECT_EQ(l4d_renderer_create(&options, &renderer), L4D_ERR_FEATURE_UNSUPPORTED);
  if (has_device()) return;
  const RendererHandle device = make_device();
  const io::Scene scene = synth(10);
  const l4d_gaussians gaussians = scene.view();
  EXPECT_EQ(l4d_renderer_set_gaussians(device.get(), &gaussians, &scene.timeline), L4D_ERR_DEVICE);
  EXPECT_NE(std::string(l4d_last_error_message()), "");
}

}  // namespace
}  // namespace l4d::render
