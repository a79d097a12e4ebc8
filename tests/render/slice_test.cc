// SPDX-License-Identifier: Apache-2.0
// The instants of a scene, of its attributes and of a stream.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iostream>
#include <vector>

#include "render/frame/scene.h"
#include "render/frame/slice_gradient.h"
#include "tests/common/codec.h"
#include "tests/common/test_scene.h"
#include "tests/render/scenes.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

using test::make_scene;
using test::SceneOptions;

double widened(float x) { return static_cast<double>(x); }

test::TestScene mixed_scene(uint32_t flags = 0) {
  SceneOptions options;
  options.count = 6000;
  options.time_begin = 100;
  options.sh_degree = 0;
  options.speed = 0.02;
  test::TestScene scene = make_scene(options);
  scene.flags = flags;
  if ((flags & L4D_OPACITY_LOGIT) != 0) {
    for (float& o : scene.opacity) o = std::log(o / (1.001f - o));
  }
  return scene;
}

template <typename T>
bool same(const std::vector<T>& a, const std::vector<T>& b, size_t n) {
  return std::memcmp(a.data(), b.data(), n * sizeof(T)) == 0;
}

template <typename T>
void expect_same_frame(const Frame<T>& a, const Frame<T>& b) {
  const size_t n = a.count();
  ASSERT_EQ(n, b.count());
  ASSERT_TRUE(same(a.id, b.id, n));
  EXPECT_TRUE(same(a.sh, b.sh, n));
  for (size_t k = 0; k < 3; ++k) EXPECT_TRUE(same(a.position[k], b.position[k], n));
  for (size_t k = 0; k < 6; ++k) EXPECT_TRUE(same(a.covariance[k], b.covariance[k], n));
  EXPECT_TRUE(same(a.opacity, b.opacity, n));
}

class SliceFlags : public ::testing::TestWithParam<uint32_t> {};

TEST_P(SliceFlags, FloatAndDoubleAgree) {
  const test::TestScene scene = mixed_scene(GetParam());
  const l4d_gaussians g = scene.view();
  Scene prepared;
  ASSERT_TRUE(prepared.prepare(g, scene.timeline, 2, unlimited()).ok());
  double position = 0, covariance = 0, opacity = 0;
  for (const double time : {100.0, 100.001, 100.77, 101.5, 102.0}) {
    Frame<float> frame;
    Frame<double> wide;
    EXPECT_TRUE(prepared.slice(time, 2, unlimited(), &frame).ok());
    EXPECT_TRUE(prepared.slice(time, unlimited(), &wide).ok());
    ASSERT_EQ(frame.id, wide.id) << time;
    EXPECT_GT(frame.count(), 2000u);
    EXPECT_LT(frame.count(), scene.count());
    EXPECT_EQ(frame.sh, wide.sh);
    const Instant<double> instant{time, 100, 102, (GetParam() & L4D_POSITION_AT_MEAN_TIME) != 0,
                                  (GetParam() & L4D_OPACITY_LOGIT) != 0};
    std::vector<bool> listed(scene.count(), false);
    for (size_t i = 0; i < frame.count(); ++i) {
      // The double frame against the formulas, one Gaussian at a time.
      const size_t id = frame.id[i];
      listed[id] = true;
      Gaussian4D<double> one;
      for (size_t k = 0; k < 3; ++k) one.position[k] = static_cast<double>(g.position[3 * id + k]);
      one.mean_t = static_cast<double>(g.mean_t[id]);
      const float *scale = g.log_scale + 4 * id, *rotor = g.rotor + 8 * id;
      std::transform(scale, scale + 4, one.log_scale, widened);
      std::transform(rotor, rotor + 8, one.rotor, widened);
      one.opacity = static_cast<double>(g.opacity[id]);
      const Slice3D<double> s = slice_at(one, instant);
      for (size_t k = 0; k < 3; ++k) {
        ASSERT_NEAR(wide.position[k][i], s.position[k], 1e-9 * (1 + std::fabs(s.position[k])));
        position = std::max(
            position, std::fabs(static_cast<double>(frame.position[k][i]) - wide.position[k][i]));
      }
      const double size = s.covariance[0] + s.covariance[3] + s.covariance[5];
      for (size_t k = 0; k < 6; ++k) {
        ASSERT_NEAR(wide.covariance[k][i], s.covariance[k], 1e-12 * size);
        covariance = std::max(
            covariance,
            std::fabs(static_cast<double>(frame.covariance[k][i]) - wide.covariance[k][i]) / size);
      }
      ASSERT_NEAR(wide.opacity[i], s.opacity, 1e-12);
      opacity =
          std::max(opacity, std::fabs(static_cast<double>(frame.opacity[i]) - wide.opacity[i]));
    }
    // Nothing that can be seen is missing.
    for (size_t id = 0; id < scene.count(); ++id) {
      if (listed[id]) continue;
      Gaussian4D<double> one;
      one.mean_t = static_cast<double>(g.mean_t[id]);
      for (size_t k = 0; k < 3; ++k) one.position[k] = 0;
      const float *scale = g.log_scale + 4 * id, *rotor = g.rotor + 8 * id;
      std::transform(scale, scale + 4, one.log_scale, widened);
      std::transform(rotor, rotor + 8, one.rotor, widened);
      one.opacity = static_cast<double>(g.opacity[id]);
      const Slice3D<double> s = slice_at(one, instant);
      EXPECT_TRUE(!s.visible || s.opacity < 1.0001 / 255) << id << ": " << s.opacity;
    }
  }
  std::cout << "largest errors: position " << position << ", covariance " << covariance
            << " of the trace, opacity " << opacity << "\n";
  EXPECT_LT(position, 2e-5);
  EXPECT_LT(covariance, 2e-7);
  EXPECT_LT(opacity, 1e-5);
}

INSTANTIATE_TEST_SUITE_P(Forms, SliceFlags,
                         ::testing::Values(0u, uint32_t{L4D_POSITION_AT_MEAN_TIME},
                                           uint32_t{L4D_OPACITY_LOGIT},
                                           uint32_t{L4D_POSITION_AT_MEAN_TIME} |
                                               uint32_t{L4D_OPACITY_LOGIT}));

// Still rows stay in the frame from call to call; the frame is that of a fresh scene all the same.
TEST(Slice, TimeBackAndForth) {
  const test::TestScene scene = mixed_scene();
  Scene prepared;
  ASSERT_TRUE(prepared.prepare(scene.view(), scene.timeline, 2, unlimited()).ok());
  Frame<float> frame, other;
  for (const double time : {101.0, 100.0, 102.0, 101.0, 100.3, 100.3, 101.9}) {
    EXPECT_TRUE(prepared.slice(time, 7, unlimited(), &frame).ok());
    Scene fresh;
    ASSERT_TRUE(fresh.prepare(scene.view(), scene.timeline, 1, unlimited()).ok());
    Frame<float> expected;
    EXPECT_TRUE(fresh.slice(time, 1, unlimited(), &expected).ok());
    expect_same_frame(frame, expected);
    // Another frame in between.
    if (time == 102.0) {
      EXPECT_TRUE(prepared.slice(100.5, 2, unlimited(), &other).ok());
      EXPECT_NE(other.id, frame.id);
    }
  }
}

// Gaussians that cannot change, that fade and that move are all there, told apart by what they do.
TEST(Slice, GroupsOfGaussians) {
  SceneBuilder builder;
  const double white[3] = {1, 1, 1};
  const size_t still = builder.add_ball(0, 0, 4, 0.1, 0.5, white);
  const size_t fading = builder.add_ball(1, 0, 4, 0.1, 0.5, white);
  const size_t moving = builder.add_ball(2, 0, 4, 0.1, 0.5, white);
  const size_t faint = builder.add_ball(3, 0, 4, 0.1, 0.9 / 255, white);
  io::Scene& scene = builder.scene();
  scene.log_scale[4 * fading + 3] = -1;
  scene.rotor[8 * moving + 4] = 0.05f;
  scene.log_scale[4 * moving + 3] = 2;
  Scene prepared;
  ASSERT_TRUE(prepared.prepare(scene.view(), scene.timeline, 1, unlimited()).ok());
  Frame<float> a, b;
  EXPECT_TRUE(prepared.slice(1.0, 1, unlimited(), &a).ok());
  EXPECT_TRUE(prepared.slice(1.4, 1, unlimited(), &b).ok());
  const auto row = [](const Frame<float>& f, size_t id) {
    return static_cast<size_t>(
        std::find(f.id.begin(), f.id.begin() + static_cast<std::ptrdiff_t>(f.count()), id) -
        f.id.begin());
  };
  ASSERT_EQ(a.count(), 3u);
  ASSERT_EQ(b.count(), 3u);
  EXPECT_EQ(row(a, faint), a.count());
  EXPECT_EQ(a.opacity[row(a, still)], b.opacity[row(b, still)]);
  EXPECT_EQ(a.position[0][row(a, fading)], b.position[0][row(b, fading)]);
  EXPECT_NEAR(b.opacity[row(b, fading)], 0.5 * std::exp(-0.5 * 0.16 * std::exp(2.0)), 1e-6);
  float moved = 0;
  for (size_t k = 0; k < 3; ++k) {
    moved += std::fabs(a.position[k][row(a, moving)] - b.position[k][row(b, moving)]);
  }
  EXPECT_GT(moved, 1e-4f);
}

// A stream without loss shows what its scene shows.
TEST(Slice, LosslessStreamRendersLikeTheScene) {
  SceneOptions options;
  options.count = 3000;
  options.sh_degree = 2;
  options.speed = 0.01;
  test::TestScene scene = make_scene(options);
  scene.flags = L4D_POSITION_AT_MEAN_TIME;  // as streams hold it
  test::EncodeOptions lossless;
  lossless.preset = "lossless";
  lossless.settings = {{L4D_ENC_ZSTD_LEVEL, 3}};
  const Bytes file = test::encode(scene, lossless).bytes;
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  RendererHandle from_stream = make_renderer(L4D_BACKEND_CPU);
  RendererHandle from_scene = make_renderer(L4D_BACKEND_CPU);
  RendererHandle reference = make_renderer(L4D_BACKEND_REFERENCE);
  from_stream.set_decoder(decoder);
  reference.set_decoder(decoder);
  from_scene.set_gaussians(scene.view(), scene.timeline);
  const double eye[3] = {-7, -2, -5}, target[3] = {0, 0, 0};
  const l4d_camera camera = call_on(150, 101, 120, eye, target);
  for (const double time : {0.0, 1.1, 0.4, 1.99, -5.0, 1e9}) {
    from_stream.set_time(time);
    from_scene.set_time(time);
    reference.set_time(time);
    const TestImage a = render_both(from_stream, camera), b = render_both(from_scene, camera);
    const TestImage c = render_both(reference, camera);
    EXPECT_LE(largest_difference(a.rgb, b.rgb), 1.0 / 255) << time;
    EXPECT_LE(largest_difference(a.rgb, c.rgb), 1.0 / 255) << time;
    EXPECT_GT(*std::max_element(a.alpha.begin(), a.alpha.end()), 0.5f);
    EXPECT_GT(a.stats.visible, 500u);
    EXPECT_GT(a.stats.seconds[L4D_RENDER_PASS_SLICE], 0);
  }
  // And back to the scene on the same handle.
  from_stream.set_gaussians(scene.view(), scene.timeline);
  from_stream.set_time(1.1);
  from_scene.set_time(1.1);
  EXPECT_TRUE(equal_bits(from_stream.render(camera), from_scene.render(camera)));
}

}  // namespace
}  // namespace l4d::render
