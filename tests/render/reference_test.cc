// SPDX-License-Identifier: Apache-2.0
// Images of the reference rasteriser worked out by hand.
#include "render/cpu/reference.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <vector>

#include "libl4dcodec/scene/sh.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

constexpr int kWidth = 24, kHeight = 18;
constexpr size_t kPixels = kWidth * kHeight;
constexpr float kBlack[3] = {0, 0, 0};

// At the origin, looking along z; the axis meets the image between pixels.
View<double> make_test_view() {
  l4d_camera camera{};
  camera.struct_size = sizeof camera;
  camera.width = kWidth;
  camera.height = kHeight;
  camera.fx = 40;
  camera.fy = 40;
  camera.cx = 12;
  camera.cy = 9;
  camera.near_plane = 0.02;
  for (size_t k = 0; k < 3; ++k) camera.world_to_camera[5 * k] = 1;
  return make_view<double>(camera);
}

using Color = std::array<double, 3>;

// Isotropic Gaussians without view dependence.
struct TestScene {
  Frame<double> frame;
  std::deque<std::array<float, 3>> sh;

  void add(double x, double y, double z, double sigma, double opacity, const Color& color) {
    const size_t i = frame.count();
    EXPECT_TRUE(frame.resize(i + 1, unlimited()).ok());
    frame.id[i] = static_cast<uint32_t>(i);
    const double position[3] = {x, y, z};
    for (size_t k = 0; k < 3; ++k) frame.position[k][i] = position[k];
    for (size_t k = 0; k < 6; ++k) frame.covariance[k][i] = 0;
    for (const size_t k : {0u, 3u, 5u}) frame.covariance[k][i] = sigma * sigma;
    frame.opacity[i] = opacity;
    sh.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      sh.back()[c] = static_cast<float>((color[c] - 0.5) / sh_constant::k0);
    }
    frame.sh[i] = sh.back().data();
  }
};

struct Image {
  std::vector<double> rgb = std::vector<double>(3 * kPixels);
  std::vector<double> alpha = std::vector<double>(kPixels);
  Stats stats;
};

Image render(const TestScene& scene, const float* background = kBlack) {
  Image image;
  render_reference(scene.frame, make_test_view(), background, image.rgb.data(), image.alpha.data(),
                   &image.stats);
  return image;
}

// Colours pass through float coefficients.
constexpr double kColorError = 1e-7;

// Offset of a pixel's centre from (mx, my).
std::array<double, 2> offset(size_t pixel, double mx, double my) {
  const size_t column = pixel % kWidth, row = pixel / kWidth;
  return {static_cast<double>(column) + 0.5 - mx, static_cast<double>(row) + 0.5 - my};
}

double distance2(size_t pixel, double mx, double my) {
  const auto [dx, dy] = offset(pixel, mx, my);
  return dx * dx + dy * dy;
}

// alpha of a Gaussian on the axis, whose splat is round.
double alpha_on_axis(size_t pixel, double z, double sigma, double opacity) {
  const double variance = (40 * sigma / z) * (40 * sigma / z) + 0.3;
  const double alpha = opacity * std::exp(-distance2(pixel, 12, 9) / (2 * variance));
  return alpha < kMinAlpha ? 0 : std::min(alpha, kMaxAlpha);
}

TEST(Reference, OneGaussian) {
  TestScene scene;
  scene.add(0, 0, 4, 0.25, 0.8, {0.9, 0.4, 0.1});
  const Image image = render(scene);
  size_t touched = 0;
  for (size_t p = 0; p < kPixels; ++p) {
    const double alpha = alpha_on_axis(p, 4, 0.25, 0.8);
    touched += alpha > 0;
    EXPECT_NEAR(image.alpha[p], alpha, 1e-14);
    EXPECT_NEAR(image.rgb[3 * p], 0.9 * alpha, kColorError);
    EXPECT_NEAR(image.rgb[3 * p + 1], 0.4 * alpha, kColorError);
    EXPECT_NEAR(image.rgb[3 * p + 2], 0.1 * alpha, kColorError);
  }
  EXPECT_GT(touched, 100u);
  EXPECT_LT(touched, kPixels);
  EXPECT_EQ(image.stats.projected, 1u);
  EXPECT_EQ(image.stats.instances, 0u);
}

// Off the axis the mean moves by focal/z, and the affine approximation shears: along the offset
// slope s the variance is that of the axis times 1 + s^2.
TEST(Reference, OffTheAxis) {
  TestScene scene;
  const double slope = 0.2, z = 5, sigma = 0.2, opacity = 0.7;
  scene.add(slope * z, 0, z, sigma, opacity, {1, 1, 1});
  const Image image = render(scene);
  const double variance = (40 * sigma / z) * (40 * sigma / z);
  const double vx = variance * (1 + slope * slope) + 0.3, vy = variance + 0.3;
  for (size_t p = 0; p < kPixels; ++p) {
    const auto [dx, dy] = offset(p, 12 + 40 * slope, 9);
    const double alpha = opacity * std::exp(-dx * dx / (2 * vx) - dy * dy / (2 * vy));
    EXPECT_NEAR(image.alpha[p], alpha < kMinAlpha ? 0 : alpha, 1e-14);
  }
}

TEST(Reference, TwoGaussiansBlendByDepth) {
  const Color near_color = {0.9, 0.1, 0.3}, far_color = {0.2, 0.8, 0.6};
  const float background[3] = {0.25f, 0.5f, 1.5f};
  TestScene scene, swapped;
  scene.add(0, 0, 8, 0.6, 0.9, far_color);
  scene.add(0, 0, 4, 0.2, 0.7, near_color);
  swapped.add(0, 0, 4, 0.2, 0.7, near_color);
  swapped.add(0, 0, 8, 0.6, 0.9, far_color);
  const Image image = render(scene, background);
  for (size_t p = 0; p < kPixels; ++p) {
    const double a = alpha_on_axis(p, 4, 0.2, 0.7), b = alpha_on_axis(p, 8, 0.6, 0.9);
    for (size_t c = 0; c < 3; ++c) {
      const double expected = a * near_color[c] + (1 - a) * b * far_color[c] +
                              (1 - a) * (1 - b) * static_cast<double>(background[c]);
      EXPECT_NEAR(image.rgb[3 * p + c], expected, kColorError);
    }
    EXPECT_NEAR(image.alpha[p], 1 - (1 - a) * (1 - b), 1e-14);
  }
  EXPECT_EQ(image.rgb, render(swapped, background).rgb);
}

TEST(Reference, EqualDepthsBlendInOrder) {
  TestScene scene;
  scene.add(0, 0, 4, 0.2, 0.7, {1, 0, 0});
  scene.add(0, 0, 4, 0.2, 0.7, {0, 1, 0});
  const Image image = render(scene);
  const size_t center = 9 * kWidth + 12;
  const double a = alpha_on_axis(center, 4, 0.2, 0.7);
  EXPECT_NEAR(image.rgb[3 * center], a, kColorError);
  EXPECT_NEAR(image.rgb[3 * center + 1], (1 - a) * a, kColorError);
}

TEST(Reference, EmptySceneIsBackground) {
  const float background[3] = {0.125f, 0.5f, 2.0f};
  const Image image = render(TestScene(), background);
  for (size_t p = 0; p < kPixels; ++p) {
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_EQ(image.rgb[3 * p + c], static_cast<double>(background[c]));
    }
    EXPECT_EQ(image.alpha[p], 0);
  }
}

TEST(Reference, NearPlane) {
  for (const double z : {-4.0, 0.0, 0.02}) {
    TestScene scene;
    scene.add(0, 0, z, 0.25, 0.8, {1, 1, 1});
    const Image image = render(scene);
    EXPECT_EQ(image.stats.projected, 0u) << z;
    for (const double a : image.alpha) EXPECT_EQ(a, 0);
  }
  TestScene scene;
  scene.add(0, 0, 0.0201, 1e-4, 0.8, {1, 1, 1});
  EXPECT_EQ(render(scene).stats.projected, 1u);
}

TEST(Reference, OutsideTheFrame) {
  TestScene scene;
  scene.add(4, 0, 4, 0.1, 0.8, {1, 1, 1});
  scene.add(0, -4, 4, 0.1, 0.8, {1, 1, 1});
  scene.add(0, 0, 4, 0.1, 0.9 / 255, {1, 1, 1});  // too faint to be seen
  const Image image = render(scene);
  EXPECT_EQ(image.stats.projected, 0u);
  for (const double a : image.alpha) EXPECT_EQ(a, 0);
}

TEST(Reference, FaintPixelsAreSkipped) {
  TestScene scene;
  scene.add(0, 0, 4, 0.3, 0.02, {1, 1, 1});
  const Image image = render(scene);
  const double reach2 = 2 * std::log(0.02 * 255) * ((40 * 0.3 / 4) * (40 * 0.3 / 4) + 0.3);
  size_t inside = 0;
  for (size_t p = 0; p < kPixels; ++p) {
    EXPECT_EQ(image.alpha[p] > 0, distance2(p, 12, 9) <= reach2) << p;
    if (image.alpha[p] > 0) {
      EXPECT_GE(image.alpha[p], kMinAlpha * (1 - 1e-12));
    }
    inside += image.alpha[p] > 0;
  }
  EXPECT_GT(inside, 50u);
  EXPECT_LT(inside, kPixels);
}

TEST(Reference, AlphaIsCutAndPixelsFinish) {
  TestScene scene;
  scene.add(0, 0, 2, 100, 1.0, {1, 0, 0});
  const Image flat = render(scene);
  const size_t center = 9 * kWidth + 12;
  EXPECT_DOUBLE_EQ(flat.alpha[center], kMaxAlpha);

  // Transmittance 1e-3 is left. The second would leave 1e-6: it is not blended and the pixel is
  // done, so that the third, which would leave 5e-4, is not blended either.
  scene.add(0, 0, 3, 100, 1.0, {0, 1, 0});
  scene.add(0, 0, 4, 100, 0.5, {0, 0, 1});
  const Image done = render(scene);
  EXPECT_EQ(done.alpha[center], flat.alpha[center]);
  EXPECT_NEAR(done.rgb[3 * center], kMaxAlpha, kColorError);
  EXPECT_NEAR(done.rgb[3 * center + 1], 0, kColorError);
  EXPECT_NEAR(done.rgb[3 * center + 2], 0, kColorError);
  scene.frame.opacity[1] = 0;
  const Image rest = render(scene);
  EXPECT_NEAR(rest.rgb[3 * center + 2], 1e-3 * 0.5, 1e-6);
}

TEST(Reference, ColorsAreClampedBelowOnly) {
  TestScene scene;
  scene.add(0, 0, 4, 0.25, 0.8, {-0.5, 3.0, 0.5});
  const Image image = render(scene);
  const size_t center = 9 * kWidth + 12;
  EXPECT_EQ(image.rgb[3 * center], 0);
  EXPECT_NEAR(image.rgb[3 * center + 1], 3 * image.alpha[center], 1e-6);
}

TestScene crowd() {
  TestScene scene;
  for (int i = 0; i < 12; ++i) {
    scene.add(0.2 * (i % 4) - 0.3, 0.15 * (i % 3) - 0.2, 3 + 0.37 * (i * 5 % 12), 0.05 + 0.02 * i,
              i == 7 ? 0.003 : 0.2 + 0.07 * i, {0.1 * i, 0.5, 1 - 0.08 * i});
  }
  return scene;
}

TEST(Reference, ForwardRoundsTheWideImage) {
  const TestScene scene = crowd();
  const float background[3] = {0.1f, 0.2f, 0.3f};
  const Image wide = render(scene, background);
  const auto rasterizer = make_reference_rasterizer(unlimited());
  std::vector<float> rgb(3 * kPixels), alpha(kPixels);
  Stats stats;
  const View<double> view = make_test_view();
  EXPECT_TRUE(
      rasterizer->forward(scene.frame, view, background, rgb.data(), alpha.data(), &stats).ok());
  for (size_t k = 0; k < rgb.size(); ++k) EXPECT_EQ(rgb[k], static_cast<float>(wide.rgb[k]));
  for (size_t k = 0; k < kPixels; ++k) EXPECT_EQ(alpha[k], static_cast<float>(wide.alpha[k]));
  EXPECT_EQ(stats.projected, 11u);
  EXPECT_GT(stats.seconds[L4D_RENDER_PASS_BLEND], 0);
  // Either output is optional, and so is the account.
  std::vector<float> alone(3 * kPixels);
  EXPECT_TRUE(
      rasterizer->forward(scene.frame, view, background, alone.data(), nullptr, nullptr).ok());
  EXPECT_EQ(alone, rgb);
  std::vector<float> alpha_alone(kPixels);
  EXPECT_TRUE(
      rasterizer->forward(scene.frame, view, background, nullptr, alpha_alone.data(), nullptr)
          .ok());
  EXPECT_EQ(alpha_alone, alpha);
}

TEST(Reference, CoverageAddsUpToAlpha) {
  const TestScene scene = crowd();
  const Image image = render(scene);
  double total = 0;
  for (const double a : image.alpha) total += a;
  const auto rasterizer = make_reference_rasterizer(unlimited());
  ViewGradients<double> all, coverage_only;
  const View<double> view = make_test_view();
  Stats stats;
  EXPECT_TRUE(rasterizer->backward(scene.frame, view, kBlack, BackwardInput(), &all, &stats).ok());
  BackwardInput input;
  input.geometry = false;
  EXPECT_TRUE(rasterizer->backward(scene.frame, view, kBlack, input, &coverage_only, nullptr).ok());
  EXPECT_EQ(all.coverage, coverage_only.coverage);
  ASSERT_EQ(all.splat.size(), scene.frame.count());
  double covered = 0;
  for (size_t i = 0; i < all.coverage.size(); ++i) {
    covered += all.coverage[i];
    EXPECT_DOUBLE_EQ(all.splat[i].color[0], all.coverage[i]);
  }
  EXPECT_NEAR(covered, total, 1e-10);
  EXPECT_EQ(all.coverage[7], 0);  // too faint
  EXPECT_EQ(all.splat[7].opacity, 0);
  EXPECT_GT(stats.seconds[L4D_RENDER_PASS_BACKWARD], 0);
}

bool equal(const SplatGradient2D<double>& a, const SplatGradient2D<double>& b) {
  bool same = a.opacity == b.opacity && a.mean[0] == b.mean[0] && a.mean[1] == b.mean[1];
  for (int k = 0; k < 3; ++k) same = same && a.conic[k] == b.conic[k] && a.color[k] == b.color[k];
  return same;
}

// The sum of all pixels is the short form of ones given pixel by pixel.
TEST(Reference, UpstreamForms) {
  const TestScene scene = crowd();
  const auto rasterizer = make_reference_rasterizer(unlimited());
  const View<double> view = make_test_view();
  const float background[3] = {0.3f, 0.2f, 0.1f};
  std::vector<float> ones(3 * kPixels, 1.0f), signs(3 * kPixels);
  for (size_t k = 0; k < signs.size(); ++k) signs[k] = k * 7 % 5 < 2 ? -1.0f : 1.0f;
  const auto backward = [&](const float* gradient) {
    BackwardInput input;
    input.rgb_gradient = gradient;
    ViewGradients<double> out;
    EXPECT_TRUE(rasterizer->backward(scene.frame, view, background, input, &out, nullptr).ok());
    return out;
  };
  const ViewGradients<double> plain = backward(nullptr);
  const ViewGradients<double> given = backward(ones.data());
  const ViewGradients<double> signed_sum = backward(signs.data());
  bool differ = false;
  for (size_t i = 0; i < scene.frame.count(); ++i) {
    EXPECT_TRUE(equal(plain.splat[i], given.splat[i])) << i;
    differ = differ || !equal(plain.splat[i], signed_sum.splat[i]);
  }
  EXPECT_TRUE(differ);
}

// For one Gaussian: d/d(opacity) = sum over pixels of exp(-q/2) (color - background) g.
TEST(Reference, DerivativeOfOneGaussianByHand) {
  TestScene scene;
  scene.add(0, 0, 4, 0.25, 0.8, {0.9, 0.4, 0.1});
  const float background[3] = {0.5f, 0.25f, 0.75f};
  ViewGradients<double> out;
  EXPECT_TRUE(
      make_reference_rasterizer(unlimited())
          ->backward(scene.frame, make_test_view(), background, BackwardInput(), &out, nullptr)
          .ok());
  double by_opacity = 0;
  for (size_t p = 0; p < kPixels; ++p) {
    by_opacity += alpha_on_axis(p, 4, 0.25, 0.8) / 0.8 * ((0.9 + 0.4 + 0.1) - 1.5);
  }
  EXPECT_NEAR(out.splat[0].opacity, by_opacity, 1e-5);
  EXPECT_LT(by_opacity, -1);
  // The splat and the image are symmetric.
  EXPECT_NEAR(out.splat[0].mean[0], 0, 1e-10);
  EXPECT_NEAR(out.splat[0].mean[1], 0, 1e-10);
}

// A colour that depends on the direction is that of the direction from the camera, wherever it is
// and however it is turned.
TEST(Reference, ColorsAreSeenFromTheCamera) {
  TestScene scene;
  const double at[3] = {1, -2, 3};
  scene.add(at[0], at[1], at[2], 0.2, 0.9, {0.5, 0.5, 0.5});
  // Red grows with -y, green with z, blue with -x (the harmonics of degree 1).
  const float sh[12] = {0, 0, 0, 0.4f, 0, 0, 0, 0.4f, 0, 0, 0, 0.4f};
  scene.frame.sh_degree = 1;
  scene.frame.sh[0] = sh;
  for (int i = 0; i < 12; ++i) {
    // Axes of the camera: a turn about y, then one about x.
    const double a = 0.7 * i, b = 0.3 * i - 1;
    const double right[3] = {std::cos(a), 0, -std::sin(a)};
    const double forward[3] = {std::sin(a) * std::cos(b), std::sin(b), std::cos(a) * std::cos(b)};
    double down[3], eye[3];
    for (int k = 0; k < 3; ++k) {
      const int m = (k + 1) % 3, n = (k + 2) % 3;
      down[k] = forward[m] * right[n] - forward[n] * right[m];
      eye[k] = at[k] - 4 * forward[k] + 0.2 * right[k];
    }
    l4d_camera camera{};
    camera.struct_size = sizeof camera;
    camera.width = kWidth;
    camera.height = kHeight;
    camera.fx = camera.fy = 40;
    camera.cx = 12;
    camera.cy = 9;
    camera.near_plane = 0.02;
    const double* const axes[3] = {right, down, forward};
    double distance2 = 0;
    for (size_t r = 0; r < 3; ++r) {
      for (size_t k = 0; k < 3; ++k) {
        camera.world_to_camera[4 * r + k] = axes[r][k];
        camera.world_to_camera[4 * r + 3] -= axes[r][k] * eye[k];
      }
      distance2 += (at[r] - eye[r]) * (at[r] - eye[r]);
    }
    std::vector<double> rgb(3 * kPixels), alpha(kPixels);
    render_reference(scene.frame, make_view<double>(camera), kBlack, rgb.data(), alpha.data(),
                     nullptr);
    const size_t pixel =
        static_cast<size_t>(std::max_element(alpha.begin(), alpha.end()) - alpha.begin());
    ASSERT_GT(alpha[pixel], 0.5);
    const double k1 = std::sqrt(3 / (4 * 3.14159265358979323846)) * 0.4 / std::sqrt(distance2);
    const double expected[3] = {0.5 - k1 * (at[1] - eye[1]), 0.5 + k1 * (at[2] - eye[2]),
                                0.5 - k1 * (at[0] - eye[0])};
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(rgb[3 * pixel + c] / alpha[pixel], expected[c], 1e-6) << i << ", " << c;
    }
  }
}

}  // namespace
}  // namespace l4d::render
