// SPDX-License-Identifier: Apache-2.0
// The renderer's C API: NULL, wrong moments, older structs, invalid cameras, and what the
// error message says.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "l4d/experimental/sensitivity.hpp"
#include "tests/common/codec.h"

namespace l4d {
namespace {

constexpr l4d_status kInvalid = L4D_ERR_INVALID_ARGUMENT;
constexpr l4d_status kState = L4D_ERR_INVALID_STATE;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Two Gaussians in front of a camera at the origin.
struct TestScene {
  float position[6] = {0, 0, 4, 0.5f, 0, 5};
  float mean_t[2] = {1, 1};
  float log_scale[8] = {-1, -1, -1, 8, -1, -1, -1, 8};
  float rotor[16] = {1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0};
  float opacity[2] = {0.8f, 0.6f};
  float sh[6] = {1, 0, 0, 0, 1, 0};
  l4d_timeline timeline{0, 60, 30, 1, 0};
  l4d_gaussians view() const {
    l4d_gaussians g = L4D_INIT(l4d_gaussians);
    g.count = 2;
    g.position = position;
    g.mean_t = mean_t;
    g.log_scale = log_scale;
    g.rotor = rotor;
    g.opacity = opacity;
    g.sh = sh;
    return g;
  }
};

constexpr uint32_t kWidth = 20, kHeight = 14;
constexpr size_t kPixels = kWidth * kHeight;

l4d_camera test_camera() {
  l4d_camera camera = L4D_INIT(l4d_camera);
  camera.width = kWidth;
  camera.height = kHeight;
  camera.fx = camera.fy = 20;
  camera.cx = 10;
  camera.cy = 7;
  camera.near_plane = 0.02;
  for (size_t k = 0; k < 3; ++k) camera.world_to_camera[5 * k] = 1;
  return camera;
}

std::string detail() { return l4d_last_error_message(); }

struct Ready {
  TestScene scene;
  RendererHandle r;
  explicit Ready(const l4d_renderer_options* options = nullptr) : r(options) {
    r.set_gaussians(scene.view(), scene.timeline);
    r.set_time(1);
  }
};

std::vector<float> rendered(const RendererHandle& r) { return r.render(test_camera()); }

TEST(RenderArguments, NullHandles) {
  const TestScene scene;
  const l4d_gaussians g = scene.view();
  const l4d_camera camera = test_camera();
  const float f[3] = {0, 0, 0};
  float out[3];
  l4d_image image = L4D_INIT(l4d_image);
  l4d_gradients gradients = L4D_INIT(l4d_gradients);
  l4d_render_stats stats = L4D_INIT(l4d_render_stats);
  const l4d_view view{};
  float* const weights[L4D_WEIGHT_COUNT] = {};
  EXPECT_EQ(l4d_renderer_create(nullptr, nullptr), kInvalid);
  EXPECT_EQ(l4d_renderer_set_gaussians(nullptr, &g, &scene.timeline), kInvalid);
  EXPECT_EQ(l4d_renderer_set_streams(nullptr, nullptr, nullptr, 1, nullptr), kInvalid);
  EXPECT_EQ(l4d_renderer_set_background(nullptr, f), kInvalid);
  EXPECT_EQ(l4d_renderer_set_time(nullptr, 0), kInvalid);
  EXPECT_EQ(l4d_renderer_render(nullptr, &camera, &image), kInvalid);
  EXPECT_EQ(l4d_renderer_backward(nullptr, &camera, f, &gradients), kInvalid);
  EXPECT_EQ(l4d_renderer_get_stats(nullptr, &stats), kInvalid);
  EXPECT_EQ(l4d_measure_importance(nullptr, &camera, 1, &view, 1, nullptr, weights, 2, nullptr),
            kInvalid);
  EXPECT_EQ(l4d_sensitivity_create(nullptr, 2, 0, nullptr), kInvalid);
  EXPECT_EQ(l4d_sensitivity_add_view(nullptr, nullptr, &camera, 0), kInvalid);
  EXPECT_EQ(l4d_sensitivity_get_weights(nullptr, 0, out, 3), kInvalid);
  l4d_renderer_destroy(nullptr);
  l4d_sensitivity_destroy(nullptr);
}

TEST(RenderState, ACallThatIsCancelledSaysSo) {
  int32_t cancel = 0;
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.cancel = &cancel;
  Ready at(&options);
  const std::vector<float> whole = rendered(at.r);
  cancel = 1;
  const l4d_camera camera = test_camera();
  std::vector<float> rgb(whole.size());
  l4d_image image = L4D_INIT(l4d_image);
  image.rgb = rgb.data();
  EXPECT_EQ(l4d_renderer_render(at.r.get(), &camera, &image), L4D_ERR_CANCELLED);
  cancel = 0;
  EXPECT_EQ(rendered(at.r), whole);
}

// Flashes of 20 ms, counted from 1970: the picture is that of the same scene counted from 0.
TEST(RenderTimes, DoubleOnesAreNotRounded) {
  constexpr double kBegin = 1763800000;
  TestScene near, far;
  const double times[2] = {kBegin + 1.03125, kBegin + 1.0625};  // exact as float too, less kBegin
  for (size_t i = 0; i < 2; ++i) {
    near.log_scale[4 * i + 3] = far.log_scale[4 * i + 3] = std::log(0.02f);
    near.mean_t[i] = static_cast<float>(times[i] - kBegin);
  }
  far.timeline.time_begin = kBegin;
  l4d_gaussians g = far.view();
  g.mean_t = nullptr;
  g.mean_t_double = times;
  for (const uint32_t backend : {L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU}) {
    l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
    options.backend = backend;
    RendererHandle a(&options), b(&options);
    a.set_gaussians(near.view(), near.timeline);
    b.set_gaussians(g, far.timeline);
    for (const double t : {1.03125, 1.046875, 1.0625}) {
      a.set_time(t);
      b.set_time(kBegin + t);
      const std::vector<float> want = rendered(a), got = rendered(b);
      EXPECT_GT(*std::max_element(want.begin(), want.end()), 0.1f);
      for (size_t k = 0; k < want.size(); ++k) ASSERT_NEAR(got[k], want[k], 1e-5) << t;
    }
  }
}

TEST(RenderArguments, NullPointers) {
  Ready at;
  l4d_renderer* r = at.r.get();
  const l4d_gaussians g = at.scene.view();
  const l4d_camera camera = test_camera();
  const std::vector<float> gradient(3 * kPixels);
  l4d_image image = L4D_INIT(l4d_image);
  l4d_gradients gradients = L4D_INIT(l4d_gradients);
  gradients.count = 2;
  EXPECT_EQ(l4d_renderer_set_gaussians(r, nullptr, &at.scene.timeline), kInvalid);
  EXPECT_EQ(l4d_renderer_set_gaussians(r, &g, nullptr), kInvalid);
  l4d_decoder* const none = nullptr;
  EXPECT_EQ(l4d_renderer_set_streams(r, nullptr, nullptr, 1, nullptr), kInvalid);
  EXPECT_EQ(l4d_renderer_set_streams(r, &none, nullptr, 0, nullptr), kInvalid);
  EXPECT_EQ(l4d_renderer_set_streams(r, &none, nullptr, 1, nullptr), kInvalid);
  const DecoderHandle closed;
  l4d_decoder* const decoder = closed.get();
  const double never = std::numeric_limits<double>::infinity();
  EXPECT_EQ(l4d_renderer_set_streams(r, &decoder, &never, 1, nullptr), kInvalid);
  EXPECT_EQ(l4d_renderer_set_streams(r, &decoder, nullptr, 1, nullptr), kState);
  EXPECT_EQ(l4d_renderer_set_background(r, nullptr), kInvalid);
  EXPECT_EQ(l4d_renderer_render(r, nullptr, &image), kInvalid);
  EXPECT_EQ(l4d_renderer_render(r, &camera, nullptr), kInvalid);
  EXPECT_EQ(l4d_renderer_backward(r, nullptr, gradient.data(), &gradients), kInvalid);
  EXPECT_EQ(l4d_renderer_backward(r, &camera, nullptr, &gradients), kInvalid);
  EXPECT_EQ(l4d_renderer_backward(r, &camera, gradient.data(), nullptr), kInvalid);
  EXPECT_EQ(l4d_renderer_get_stats(r, nullptr), kInvalid);
  EXPECT_NE(detail().find("NULL"), std::string::npos);
  // The scene is as it was; an image of nothing and gradients of nothing are none, but no error.
  EXPECT_EQ(l4d_renderer_render(r, &camera, &image), L4D_OK);
  EXPECT_EQ(l4d_renderer_backward(r, &camera, gradient.data(), &gradients), L4D_OK);

  SensitivityHandle s(nullptr, 2, 0);
  float out[2];
  EXPECT_EQ(l4d_sensitivity_add_view(s.get(), nullptr, &camera, 0), kInvalid);
  EXPECT_EQ(l4d_sensitivity_add_view(s.get(), r, nullptr, 0), kInvalid);
  s.add_view(at.r, camera);
  EXPECT_EQ(l4d_sensitivity_get_weights(s.get(), L4D_WEIGHT_SH, nullptr, 2), kInvalid);
  EXPECT_EQ(l4d_sensitivity_get_weights(s.get(), L4D_WEIGHT_SH, out, 3), kInvalid);
  EXPECT_EQ(l4d_sensitivity_get_weights(s.get(), L4D_WEIGHT_COUNT, out, 2), kInvalid);
  EXPECT_EQ(l4d_sensitivity_get_weights(s.get(), L4D_WEIGHT_SH, out, 2), L4D_OK);
}

TEST(RenderArguments, OptionsOutOfRange) {
  const auto created = [](const std::function<void(l4d_renderer_options&)>& change) {
    l4d_renderer_options o = L4D_INIT(l4d_renderer_options);
    change(o);
    l4d_renderer* r = nullptr;
    const l4d_status status = l4d_renderer_create(&o, &r);
    EXPECT_EQ(r != nullptr, status == L4D_OK);
    l4d_renderer_destroy(r);
    return status;
  };
  EXPECT_EQ(created([](auto&) {}), L4D_OK);
  EXPECT_EQ(created([](auto& o) { o.backend = 4; }), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(created([](auto& o) { o.exponential = 2; }), kInvalid);
  EXPECT_EQ(created([](auto& o) { o.threads = 1u << 31; }), kInvalid);
  l4d_sensitivity_options o = L4D_INIT(l4d_sensitivity_options);
  l4d_sensitivity* s = nullptr;
  EXPECT_EQ(l4d_sensitivity_create(&o, 2, 4, &s), kInvalid);
  o.metric = 2;
  EXPECT_EQ(l4d_sensitivity_create(&o, 2, 0, &s), kInvalid);
  EXPECT_EQ(s, nullptr);
}

TEST(RenderStructs, Defaults) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  EXPECT_EQ(options.struct_size, sizeof options);
  EXPECT_EQ(options.backend, uint32_t{L4D_BACKEND_AUTO});
  EXPECT_EQ(options.threads, 0u);
  l4d_camera camera = L4D_INIT(l4d_camera);
  EXPECT_EQ(camera.struct_size, sizeof camera);
  l4d_measure_options measure = L4D_INIT(l4d_measure_options);
  EXPECT_EQ(measure.struct_size, sizeof measure);
  EXPECT_EQ(measure.metric, uint32_t{L4D_SENSITIVITY_SUM});
  l4d_image image = L4D_INIT(l4d_image);
  EXPECT_EQ(image.rgb, nullptr);
  EXPECT_EQ(image.struct_size, sizeof image);
}

// Zeros draw and measure as the numbers do that the header names.
TEST(RenderStructs, ZeroIsTheDefault) {
  const Ready at;
  const std::vector<float> expected = rendered(at.r);
  l4d_camera camera = test_camera();
  camera.near_plane = 0;
  for (size_t k = 0; k < 3; ++k) camera.world_to_camera[5 * k] = 0;
  std::vector<float> rgb(3 * kPixels);
  l4d_image image = L4D_INIT(l4d_image);
  image.rgb = rgb.data();
  EXPECT_EQ(l4d_renderer_render(at.r.get(), &camera, &image), L4D_OK);
  EXPECT_EQ(rgb, expected);
  l4d_rendering rendering = L4D_INIT(l4d_rendering);
  EXPECT_EQ(l4d_renderer_set_rendering(at.r.get(), &rendering), L4D_OK);
  EXPECT_EQ(rendered(at.r), expected);
  rendering.dilation = 0.3f;
  EXPECT_EQ(l4d_renderer_set_rendering(at.r.get(), &rendering), kInvalid);  // min_alpha is 0
  rendering.min_alpha = 1.0f / 255.0f;
  rendering.max_alpha = 0.999f;
  EXPECT_EQ(l4d_renderer_set_rendering(at.r.get(), &rendering), L4D_OK);
  EXPECT_EQ(rendered(at.r), expected);
}

// Programs of later versions give structs that are longer. Of older programs see tests/abi.
TEST(RenderStructs, Newer) {
  const Ready at;
  const std::vector<float> expected = rendered(at.r);
  l4d_camera camera = test_camera();
  camera.struct_size = sizeof camera + 8;
  std::vector<float> rgb(3 * kPixels), alpha(kPixels, -1.0f);
  l4d_image image = L4D_INIT(l4d_image);
  image.rgb = rgb.data();
  image.alpha = alpha.data();
  at.r.check(l4d_renderer_render(at.r.get(), &camera, &image));
  EXPECT_EQ(rgb, expected);

  struct {
    l4d_render_stats stats;
    unsigned char beyond[16];
  } newer;
  std::memset(&newer, 0x5a, sizeof newer);
  newer.stats.struct_size = sizeof newer;
  EXPECT_EQ(l4d_renderer_get_stats(at.r.get(), &newer.stats), L4D_OK);
  EXPECT_EQ(newer.stats.visible, 2u);
  EXPECT_EQ(newer.stats.projected, 2u);
  EXPECT_GE(newer.stats.instances, 2u);
  EXPECT_EQ(newer.stats.struct_size, sizeof newer);
  for (const unsigned char b : newer.beyond) EXPECT_EQ(b, 0x5a);
}

// Smaller than its first version no struct is: it was not made by L4D_INIT.
TEST(RenderStructs, SmallerThanAnyVersion) {
  const Ready at;
  for (const size_t size : {size_t{0}, sizeof(size_t)}) {
    l4d_renderer_options options{};
    options.struct_size = size;
    l4d_renderer* renderer = nullptr;
    EXPECT_EQ(l4d_renderer_create(&options, &renderer), kInvalid);
    EXPECT_EQ(renderer, nullptr);
    EXPECT_NE(std::string(l4d_last_error_message()).find("struct_size"), std::string::npos);
    l4d_camera camera = test_camera();
    l4d_image image = L4D_INIT(l4d_image);
    image.struct_size = size;
    EXPECT_EQ(l4d_renderer_render(at.r.get(), &camera, &image), kInvalid);
    image = L4D_INIT(l4d_image);
    camera.struct_size = size;
    EXPECT_EQ(l4d_renderer_render(at.r.get(), &camera, &image), kInvalid);
    l4d_render_stats stats{};
    stats.struct_size = size;
    EXPECT_EQ(l4d_renderer_get_stats(at.r.get(), &stats), kInvalid);
  }
}

TEST(RenderState, InOrder) {
  const TestScene scene;
  const l4d_gaussians g = scene.view();
  const l4d_camera camera = test_camera();
  RendererHandle r;
  l4d_image image = L4D_INIT(l4d_image);
  EXPECT_EQ(l4d_renderer_set_time(r.get(), 0), kState);
  EXPECT_NE(detail().find("set_gaussians"), std::string::npos);
  EXPECT_EQ(l4d_renderer_render(r.get(), &camera, &image), kState);
  EXPECT_NE(detail().find("set_time"), std::string::npos);
  r.set_gaussians(g, scene.timeline);
  EXPECT_EQ(l4d_renderer_render(r.get(), &camera, &image), kState);
  EXPECT_EQ(l4d_renderer_set_time(r.get(), kNan), kInvalid);
  EXPECT_EQ(l4d_renderer_render(r.get(), &camera, &image), kState);
  r.set_time(-kInfinity);  // clamped
  EXPECT_EQ(l4d_renderer_render(r.get(), &camera, &image), L4D_OK);
  // Another scene has no instant yet; one that is refused leaves none.
  r.set_gaussians(g, scene.timeline);
  EXPECT_EQ(l4d_renderer_render(r.get(), &camera, &image), kState);
  l4d_gaussians bad = g;
  bad.sh_degree = 4;
  EXPECT_EQ(l4d_renderer_set_gaussians(r.get(), &bad, &scene.timeline), kInvalid);
  EXPECT_EQ(l4d_renderer_set_time(r.get(), 0), kState);
  // A decoder without a stream.
  const DecoderHandle decoder;
  l4d_decoder* const stream = decoder.get();
  EXPECT_EQ(l4d_renderer_set_streams(r.get(), &stream, nullptr, 1, nullptr), kState);
  EXPECT_NE(detail().find("stream"), std::string::npos);
}

TEST(RenderState, ScenesThatAreNone) {
  const TestScene good;
  RendererHandle r;
  const auto status = [&](const TestScene& s) {
    const l4d_gaussians g = s.view();
    return l4d_renderer_set_gaussians(r.get(), &g, &s.timeline);
  };
  EXPECT_EQ(status(good), L4D_OK);
  const struct {
    const char* attribute;
    std::function<void(TestScene&, float)> set;
  } changes[] = {{"position", [](TestScene& s, float v) { s.position[4] = v; }},
                 {"mean_t", [](TestScene& s, float v) { s.mean_t[1] = v; }},
                 {"log_scale", [](TestScene& s, float v) { s.log_scale[7] = v; }},
                 {"rotor", [](TestScene& s, float v) { s.rotor[9] = v; }},
                 {"opacity", [](TestScene& s, float v) { s.opacity[1] = v; }},
                 {"sh", [](TestScene& s, float v) { s.sh[5] = v; }}};
  for (const auto& change : changes) {
    for (const double v : {kNan, kInfinity, -kInfinity}) {
      TestScene bad;
      change.set(bad, static_cast<float>(v));
      EXPECT_EQ(status(bad), L4D_ERR_INVALID_SCENE) << change.attribute;
      EXPECT_NE(detail().find("Gaussian 1: " + std::string(change.attribute)), std::string::npos)
          << detail();
    }
  }
  TestScene bad;
  bad.log_scale[0] = 17.5f;
  EXPECT_EQ(status(bad), L4D_ERR_INVALID_SCENE);
  for (int k = 0; k < 4; ++k) {
    bad = TestScene();
    if (k == 0) bad.timeline.num_frames = 0;
    if (k == 1) bad.timeline.fps_num = 0;
    if (k == 2) bad.timeline.fps_den = 0;
    if (k == 3) bad.timeline.time_begin = kNan;
    EXPECT_EQ(status(bad), kInvalid) << k;
    EXPECT_NE(detail().find("timeline"), std::string::npos);
  }
  l4d_gaussians g = good.view();
  g.rotor = nullptr;
  EXPECT_EQ(l4d_renderer_set_gaussians(r.get(), &g, &good.timeline), kInvalid);
}

TEST(RenderCamera, EachFieldIsChecked) {
  const Ready at;
  const struct {
    const char* named;
    std::function<void(l4d_camera&)> change;
  } changes[] = {
      {"width", [](l4d_camera& c) { c.width = 0; }},
      {"width", [](l4d_camera& c) { c.width = 16385; }},
      {"height", [](l4d_camera& c) { c.height = 0; }},
      {"height", [](l4d_camera& c) { c.height = 0xffffffffu; }},
      {"focal", [](l4d_camera& c) { c.fx = 0; }},
      {"focal", [](l4d_camera& c) { c.fx = kInfinity; }},
      {"focal", [](l4d_camera& c) { c.fy = -1; }},
      {"focal", [](l4d_camera& c) { c.fy = kNan; }},
      {"principal point", [](l4d_camera& c) { c.cx = kNan; }},
      {"principal point", [](l4d_camera& c) { c.cy = -kInfinity; }},
      {"near_plane", [](l4d_camera& c) { c.near_plane = -0.02; }},
      {"near_plane", [](l4d_camera& c) { c.near_plane = kNan; }},
      {"near_plane", [](l4d_camera& c) { c.near_plane = kInfinity; }},
      {"world_to_camera", [](l4d_camera& c) { c.world_to_camera[3] = kNan; }},
      {"world_to_camera", [](l4d_camera& c) { c.world_to_camera[0] = 2; }},
      {"world_to_camera", [](l4d_camera& c) { c.world_to_camera[1] = 0.5; }},
      {"world_to_camera", [](l4d_camera& c) { c.world_to_camera[10] = 0; }},
      // Shear: every row of length 1, two of them not at right angles.
      {"rotation",
       [](l4d_camera& c) {
         c.world_to_camera[0] = std::sqrt(0.75);
         c.world_to_camera[1] = 0.5;
       }},
      {"rotation",
       [](l4d_camera& c) {
         c.world_to_camera[8] = 0.6;
         c.world_to_camera[10] = 0.8;
       }},
      // Reflections: rows at right angles that mirror the scene.
      {"reflection", [](l4d_camera& c) { c.world_to_camera[0] = -1; }},
      {"reflection",
       [](l4d_camera& c) {
         for (int k = 0; k < 3; ++k) c.world_to_camera[5 * k] = -1;
       }},
      {"reflection",
       [](l4d_camera& c) {
         std::swap_ranges(c.world_to_camera, c.world_to_camera + 3, c.world_to_camera + 4);
       }},
  };
  std::vector<float> rgb(3 * kPixels, -7.0f);
  l4d_image image = L4D_INIT(l4d_image);
  image.rgb = rgb.data();
  l4d_gradients gradients = L4D_INIT(l4d_gradients);
  gradients.count = 2;
  SensitivityHandle s(nullptr, 2, 0);
  for (const auto& change : changes) {
    l4d_camera camera = test_camera();
    change.change(camera);
    EXPECT_EQ(l4d_renderer_render(at.r.get(), &camera, &image), kInvalid) << change.named;
    EXPECT_NE(detail().find(change.named), std::string::npos) << detail();
    EXPECT_EQ(l4d_renderer_backward(at.r.get(), &camera, rgb.data(), &gradients), kInvalid);
    EXPECT_EQ(l4d_sensitivity_add_view(s.get(), at.r.get(), &camera, 0), kInvalid);
    EXPECT_EQ(l4d_sensitivity_add_view(s.get(), at.r.get(), &camera, 1), kInvalid);
  }
  EXPECT_EQ(rgb, std::vector<float>(3 * kPixels, -7.0f));
  // Rotations from files with few digits pass.
  l4d_camera camera = test_camera();
  camera.world_to_camera[0] = 0.9999;
  camera.world_to_camera[1] = 1e-4;
  EXPECT_EQ(l4d_renderer_render(at.r.get(), &camera, &image), L4D_OK);
}

TEST(RenderBackward, StatesAndCounts) {
  const Ready at;
  const l4d_camera camera = test_camera();
  const std::vector<float> gradient(3 * kPixels, 1.0f);
  float opacity[2] = {0, 0};
  l4d_gradients g = L4D_INIT(l4d_gradients);
  g.opacity = opacity;
  for (const uint64_t count : {0u, 1u, 3u}) {
    g.count = count;
    EXPECT_EQ(l4d_renderer_backward(at.r.get(), &camera, gradient.data(), &g), kInvalid);
    EXPECT_NE(detail().find("count"), std::string::npos);
  }
  g.count = 2;
  EXPECT_EQ(l4d_renderer_backward(at.r.get(), &camera, gradient.data(), &g), L4D_OK);
  EXPECT_GT(opacity[0], 0);
  EXPECT_GT(opacity[1], 0);
  // A stream renders, but has no arrays to derive by.
  DecoderHandle decoder;
  decoder.open_memory(test::tiny_file().data(), test::tiny_file().size());
  RendererHandle r;
  r.set_decoder(decoder);
  r.set_time(0);
  EXPECT_EQ(rendered(r).size(), gradient.size());
  EXPECT_EQ(l4d_renderer_backward(r.get(), &camera, gradient.data(), &g), kState);
  EXPECT_NE(detail().find("set_gaussians"), std::string::npos);
  SensitivityHandle s(nullptr, 12, 0);
  EXPECT_EQ(l4d_sensitivity_add_view(s.get(), r.get(), &camera, 0), kState);
}

TEST(RenderBackground, MustBeFinite) {
  const Ready at;
  const std::vector<float> before = rendered(at.r);
  const float bad[3] = {0, std::numeric_limits<float>::infinity(), 0};
  EXPECT_EQ(l4d_renderer_set_background(at.r.get(), bad), kInvalid);
  EXPECT_NE(detail().find("background"), std::string::npos);
  EXPECT_EQ(rendered(at.r), before);
  const float blue[3] = {0, 0, 1};
  EXPECT_EQ(l4d_renderer_set_background(at.r.get(), blue), L4D_OK);
  const std::vector<float> after = rendered(at.r);
  EXPECT_EQ(after[0], before[0]);
  EXPECT_GT(after[2], before[2]);
}

TEST(RenderHandles, CppThrows) {
  const RendererHandle r;
  try {
    r.render(test_camera());
    ADD_FAILURE();
  } catch (const Error& e) {
    EXPECT_EQ(e.status(), kState);
    EXPECT_NE(std::string(e.what()).find("set_time"), std::string::npos);
  }
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.backend = 9;
  EXPECT_THROW(RendererHandle bad(&options), Error);
  EXPECT_THROW(SensitivityHandle bad(nullptr, 1, 9), Error);
  SensitivityHandle s(nullptr, 3, 1);
  EXPECT_THROW(s.weights(L4D_WEIGHT_SH), Error);
}

}  // namespace
}  // namespace l4d
