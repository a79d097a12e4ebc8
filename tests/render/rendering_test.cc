// SPDX-License-Identifier: Apache-2.0
// What a scene asks of renderers (l4d_rendering): each number does what it says, on both CPU paths,
// and a stream's own are obeyed.
#include "libl4dcodec/scene/rendering.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "io/scene/scene.h"
#include "l4d/encode.hpp"
#include "l4d/render.hpp"
#include "libl4dcodec/scene/slice.h"
#include "tests/render/scenes.h"

namespace l4d::render {
namespace {

constexpr uint32_t kSide = 41;

l4d_rendering usual() { return default_rendering(); }

// One still Gaussian at the origin, of a standard deviation in pixels, seen from z = -4.
struct OneGaussian {
  io::Scene scene;
  l4d_camera camera;

  OneGaussian(double sigma_pixels, float opacity) {
    const double eye[3] = {0, 0, -4}, target[3] = {0, 0, 0};
    camera = call_on(kSide, kSide, 80, eye, target);
    const float log_scale = static_cast<float>(std::log(sigma_pixels * 4 / 80));
    scene.sh_degree = 0;
    scene.timeline = {0, 1, 1, 1, 0};
    scene.position = {0, 0, 0};
    scene.mean_t = {0};
    scene.log_scale = {log_scale, log_scale, log_scale, 8};
    scene.rotor = {1, 0, 0, 0, 0, 0, 0, 0};
    scene.opacity = {opacity};
    scene.sh = {1.7f, 1.7f, 1.7f};
  }

  // Opacity of the picture.
  std::vector<float> alpha(uint32_t backend, const l4d_rendering* rendering) const {
    l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
    options.backend = backend;
    RendererHandle renderer(&options);
    renderer.set_gaussians(scene.view(), scene.timeline);
    renderer.set_rendering(rendering);
    renderer.set_time(0);
    std::vector<float> out(kSide * kSide);
    l4d_image image = L4D_INIT(l4d_image);
    image.alpha = out.data();
    EXPECT_EQ(l4d_renderer_render(renderer.get(), &camera, &image), L4D_OK);
    return out;
  }
};

double at(const std::vector<float>& alpha, uint32_t x, uint32_t y) {
  return static_cast<double>(alpha[kSide * y + x]);
}

class Rendering : public testing::TestWithParam<uint32_t> {};
INSTANTIATE_TEST_SUITE_P(Cpu, Rendering,
                         testing::Values(uint32_t{L4D_BACKEND_CPU},
                                         uint32_t{L4D_BACKEND_REFERENCE}));

constexpr uint32_t kMiddle = kSide / 2;

TEST_P(Rendering, DilationAddsToBothVariances) {
  const OneGaussian one(2, 0.9f);
  for (const float dilation : {0.0f, 0.1f, 0.3f, 4.0f}) {
    l4d_rendering r = usual();
    r.dilation = dilation;
    const std::vector<float> alpha = one.alpha(GetParam(), &r);
    for (const uint32_t x : {0u, 1u, 3u, 5u}) {
      const double expected = 0.9 * std::exp(-0.5 * x * x / (4 + static_cast<double>(dilation)));
      EXPECT_NEAR(at(alpha, kMiddle + x, kMiddle), expected, 2e-5) << dilation << " " << x;
      EXPECT_NEAR(at(alpha, kMiddle, kMiddle - x), expected, 2e-5) << dilation << " " << x;
    }
  }
}

TEST_P(Rendering, CutoffEndsASplat) {
  const OneGaussian one(4, 0.9f);
  l4d_rendering r = usual();
  r.dilation = 0;
  r.cutoff = 2;
  const std::vector<float> cut = one.alpha(GetParam(), &r);
  r.cutoff = 0;
  const std::vector<float> whole = one.alpha(GetParam(), &r);
  int ended = 0;
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) {
      const double dx = static_cast<double>(x) - kMiddle, dy = static_cast<double>(y) - kMiddle;
      const double q = (dx * dx + dy * dy) / 16;
      if (std::fabs(q - 4) < 1e-3) continue;  // at the border itself rounding decides
      EXPECT_EQ(at(cut, x, y), q < 4 ? at(whole, x, y) : 0) << x << " " << y;
      ended += q > 4 && at(whole, x, y) > 0;
    }
  }
  EXPECT_GT(ended, 100);
}

TEST_P(Rendering, LeastAndGreatestAlpha) {
  const OneGaussian one(4, 1);
  l4d_rendering r = usual();
  r.min_alpha = 0.1f;
  r.max_alpha = 0.75f;
  const std::vector<float> alpha = one.alpha(GetParam(), &r);
  const double greatest = *std::max_element(alpha.begin(), alpha.end());
  EXPECT_NEAR(greatest, 0.75, 1e-6);
  int faint = 0;
  for (uint32_t x = 0; x < kSide; ++x) {
    const double dx = static_cast<double>(x) - kMiddle;
    const double whole = std::exp(-0.5 * dx * dx / 16.3);
    const double expected = whole < 0.1 ? 0 : std::min(whole, 0.75);
    EXPECT_NEAR(at(alpha, x, kMiddle), expected, 2e-5) << x;
    faint += whole < 0.1 && whole > 1.0 / 255;
  }
  EXPECT_GE(faint, 6);
}

// Half a pixel wide, a splat that is dilated adds more light than it has; compensated it does not.
TEST_P(Rendering, CompensationKeepsTheLight) {
  for (const double sigma : {0.6, 1.0, 2.0}) {
    const OneGaussian one(sigma, 0.5f);
    l4d_rendering r = usual();
    const double factor = sigma * sigma / (sigma * sigma + 0.3);
    const double plain = at(one.alpha(GetParam(), &r), kMiddle, kMiddle);
    r.compensation = 1;
    EXPECT_NEAR(at(one.alpha(GetParam(), &r), kMiddle, kMiddle), plain * factor, 2e-5) << sigma;
  }
  // A splat without width has no light to keep.
  const OneGaussian thin(1e-5, 0.5f);
  l4d_rendering r = usual();
  r.compensation = 1;
  const std::vector<float> alpha = thin.alpha(GetParam(), &r);
  EXPECT_EQ(*std::max_element(alpha.begin(), alpha.end()), 0);
}

TEST_P(Rendering, NumbersOutOfRangeAreRefused) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.backend = GetParam();
  const RendererHandle renderer(&options);
  l4d_rendering r = usual();
  r.max_alpha = 1;
  EXPECT_EQ(l4d_renderer_set_rendering(renderer.get(), &r), L4D_ERR_INVALID_ARGUMENT);
  r = usual();
  r.dilation = -1;
  EXPECT_EQ(l4d_renderer_set_rendering(renderer.get(), &r), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_renderer_set_rendering(renderer.get(), nullptr), L4D_OK);
}

std::vector<float> picture(RendererHandle& renderer, const l4d_camera& camera) {
  std::vector<float> rgb(size_t{3} * camera.width * camera.height);
  l4d_image image = L4D_INIT(l4d_image);
  image.rgb = rgb.data();
  renderer.set_time(1);
  EXPECT_EQ(l4d_renderer_render(renderer.get(), &camera, &image), L4D_OK);
  return rgb;
}

// Both paths agree on a scene under any rule, and a stream is drawn as its header says.
TEST(RenderingOfScenes, PathsAgreeAndStreamsAreObeyed) {
  const io::Scene scene = synth(3000, 2);
  const l4d_camera camera = ring_camera(120, 90, 1);
  std::vector<l4d_rendering> rules(4, usual());
  rules[0].dilation = 0.05f;
  rules[0].compensation = 1;
  rules[1].cutoff = 1.5f;
  rules[2].min_alpha = 0.2f;
  rules[2].max_alpha = 0.6f;
  rules[3] = {sizeof(l4d_rendering), 1, 2, 0.01f, 0.9f, 1, 0};
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  RendererHandle fast(&options);
  options.backend = L4D_BACKEND_REFERENCE;
  RendererHandle reference(&options);
  fast.set_gaussians(scene.view(), scene.timeline);
  reference.set_gaussians(scene.view(), scene.timeline);
  const std::vector<float> plain = picture(fast, camera);
  for (const l4d_rendering& rule : rules) {
    fast.set_rendering(&rule);
    reference.set_rendering(&rule);
    const std::vector<float> ours = picture(fast, camera), theirs = picture(reference, camera);
    size_t apart = 0;
    double other = 0;
    for (size_t i = 0; i < ours.size(); ++i) {
      // A step of alpha on the other side of rounding moves single pixels.
      apart += std::fabs(ours[i] - theirs[i]) > 2e-3f;
      other = std::max(other, static_cast<double>(std::fabs(ours[i] - plain[i])));
    }
    EXPECT_LE(apart, ours.size() / 2000);
    EXPECT_GT(other, 0.02);

    EncoderHandle encoder;
    encoder.check(l4d_encoder_set_preset(encoder.get(), "lossless"));
    const l4d_gaussians view = scene.view();
    encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &scene.timeline, nullptr));
    encoder.check(l4d_encoder_set_rendering(encoder.get(), &rule));
    const std::vector<unsigned char> stream = encoder.encode();
    DecoderHandle decoder;
    decoder.open_memory(stream.data(), stream.size());
    EXPECT_EQ(decoder.rendering().stated, 1u);
    RendererHandle player;
    player.set_decoder(decoder);
    const std::vector<float> shown = picture(player, camera);
    double worst = 0;
    for (size_t i = 0; i < ours.size(); ++i) {
      worst = std::max(worst, static_cast<double>(std::fabs(ours[i] - shown[i])));
    }
    EXPECT_LT(worst, 0.02);
    // What the caller says comes first, until it is taken back.
    const l4d_rendering other_rule = usual();
    player.set_rendering(&other_rule);
    EXPECT_NE(picture(player, camera), shown);
    player.set_rendering(nullptr);
    EXPECT_EQ(picture(player, camera), shown);
  }
}

// Derivatives by opacities and colours alone take another way.
TEST(GradientsOfLight, AreThoseOfAWholeBackwardPass) {
  l4d_rendering compensated = usual();
  compensated.compensation = 1;
  const l4d_camera camera = ring_camera(60, 45, 1);
  const std::vector<float> by_pixel(size_t{3} * 60 * 45, 0.5f);
  for (const uint32_t backend : {L4D_BACKEND_CPU, L4D_BACKEND_REFERENCE}) {
    for (const bool logit : {false, true}) {
      io::Scene scene = synth(800, 2);
      for (float& o : scene.opacity) {
        const double linear =
            l4d::linear_opacity(static_cast<double>(o), (scene.flags & L4D_OPACITY_LOGIT) != 0);
        o = static_cast<float>(logit ? io::logit(linear) : linear);
      }
      scene.flags = logit ? scene.flags | L4D_OPACITY_LOGIT
                          : scene.flags & ~static_cast<uint32_t>(L4D_OPACITY_LOGIT);
      l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
      options.backend = backend;
      RendererHandle renderer(&options);
      renderer.set_gaussians(scene.view(), scene.timeline);
      for (const l4d_rendering& rule : {usual(), compensated}) {
        renderer.set_rendering(&rule);
        renderer.set_time(1);
        std::vector<float> opacity[2], sh[2], position(3 * scene.count());
        for (const size_t whole : {size_t{0}, size_t{1}}) {
          opacity[whole].resize(scene.count());
          sh[whole].resize(scene.sh.size());
          l4d_gradients gradients = L4D_INIT(l4d_gradients);
          gradients.count = scene.count();
          gradients.opacity = opacity[whole].data();
          gradients.sh = sh[whole].data();
          if (whole == 1) gradients.position = position.data();
          renderer.check(
              l4d_renderer_backward(renderer.get(), &camera, by_pixel.data(), &gradients));
        }
        EXPECT_EQ(opacity[0], opacity[1]);
        EXPECT_EQ(sh[0], sh[1]);
        EXPECT_TRUE(std::any_of(sh[0].begin(), sh[0].end(), [](float v) { return v != 0; }));
      }
    }
  }
}

}  // namespace
}  // namespace l4d::render
