// SPDX-License-Identifier: Apache-2.0
// From the attributes of 4D Gaussians to a weighted sum of pixels, and all the backward pass.
//
// The sum jumps where a pixel starts to be blended, is finished, or where alpha or a colour meets
// its bound. Differences say nothing there, so every step is watched: an image computed pixel by
// pixel, which shares no loop with the rasteriser, notes what happens to each Gaussian in each
// pixel, and a step in which any of it changes is made shorter until nothing does.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <iostream>
#include <limits>
#include <type_traits>
#include <vector>

#include "render/cpu/reference.h"
#include "render/frame/project_gradient.h"
#include "render/frame/slice_gradient.h"
#include "tests/math/reference.h"
#include "tests/render/differences.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

using differences::Errors;
using reference::Random;

constexpr uint32_t kWidth = 24, kHeight = 16;
constexpr size_t kPixels = kWidth * kHeight;
constexpr size_t kCount = 14;
constexpr float kBackground[3] = {0.25f, 0.5f, 0.125f};

struct Scene {
  uint32_t degree = 3;
  Instant<double> instant;
  std::vector<Gaussian4D<double>> gaussians;
  std::vector<std::vector<float>> sh;
};

View<double> make_test_view() {
  l4d_camera camera{};
  camera.struct_size = sizeof camera;
  camera.width = kWidth;
  camera.height = kHeight;
  camera.fx = 30;
  camera.fy = 34;
  camera.cx = 11.2;
  camera.cy = 8.6;
  camera.near_plane = 0.02;
  const double rotor[8] = {0.9, 0.3, -0.2, 0.25, 0, 0, 0, 0};
  double matrix[16];
  rotor_to_matrix(normalized_halves(rotor), matrix);
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) camera.world_to_camera[4 * r + c] = matrix[4 * r + c];
  }
  camera.world_to_camera[3] = 0.3;
  camera.world_to_camera[7] = -0.2;
  camera.world_to_camera[11] = 0.5;
  return make_view<double>(camera);
}

// Numbers of SH are multiples of 2^-8, so that a step of 2^-4 is exact in float.
float coarse(double x) { return static_cast<float>(std::round(x * 256) / 256); }

Scene random_scene(uint64_t seed, uint32_t degree, bool at_mean_time, bool logit) {
  Random random(seed);
  const View<double> view = make_test_view();
  Scene scene;
  scene.degree = degree;
  scene.instant = {6.25, 3, 13, at_mean_time, logit};
  for (size_t i = 0; i < kCount; ++i) {
    Gaussian4D<double> g;
    // Where it shall be seen: a few lie beyond the frame, where slopes are clamped, but reach into
    // it.
    const bool aside = i % 7 == 3;
    // Two are broad and so opaque that alpha is cut and pixels are finished.
    const bool opaque = i % 5 == 4;
    const double z = random.uniform(2, 6);
    const double x = aside ? 0.75 * z : z * random.uniform(-0.35, 0.35);
    const double camera[3] = {x, z * random.uniform(-0.25, 0.25), z};
    reference::random_rotor(random, 0.1, g.rotor);
    const double length = random.log_uniform(0.2, 5);
    for (double& r : g.rotor) r *= length;
    for (int k = 0; k < 3; ++k) {
      const double size = aside ? 0.7 : opaque ? 0.5 : 0.07;
      g.log_scale[k] = std::log(size * z) + random.uniform(-0.6, 0.6);
    }
    // Short-lived ones, long-lived ones that move, and some whose mean lies outside the sequence.
    g.log_scale[3] = i % 3 == 0 ? random.uniform(-0.5, 0.5) : random.uniform(2.5, 4);
    double scale[4];
    for (int k = 0; k < 4; ++k) scale[k] = std::exp(g.log_scale[k]);
    const Slice4D<double> s = slice_gaussian(normalized_halves(g.rotor), scale);
    const double sigma = 1 / std::sqrt(s.lambda);
    g.mean_t = scene.instant.time + random.uniform(-1, 1) * std::min(sigma, 3.0);
    if (i % 3 == 2) g.mean_t = i % 2 == 0 ? 13.5 : 2.5;
    if (opaque) g.mean_t = scene.instant.time + 0.01 * sigma;
    g.opacity = opaque ? 0.9999 : random.uniform(0.3, 0.95);
    if (logit) g.opacity = std::log(g.opacity / (1 - g.opacity));
    for (int k = 0; k < 3; ++k) {
      double p = view.center[k];
      for (int j = 0; j < 3; ++j) p += view.rotation[3 * j + k] * camera[j];
      g.position[k] = p - s.velocity[k] * (scene.instant.time - position_time(g, scene.instant));
    }
    scene.gaussians.push_back(g);
    scene.sh.emplace_back();
    for (size_t k = 0; k < 3 * sh_terms(degree); ++k) {
      scene.sh.back().push_back(coarse(random.normal() * (k < 3 ? 1 : 0.4)));
    }
  }
  return scene;
}

Frame<double> slice(const Scene& scene) {
  Frame<double> frame;
  frame.sh_degree = scene.degree;
  EXPECT_TRUE(frame.resize(scene.gaussians.size(), unlimited()).ok());
  for (size_t i = 0; i < frame.count(); ++i) {
    const Slice3D<double> s = slice_at(scene.gaussians[i], scene.instant);
    EXPECT_TRUE(s.visible);
    frame.id[i] = static_cast<uint32_t>(i);
    for (size_t k = 0; k < 3; ++k) frame.position[k][i] = s.position[k];
    for (size_t k = 0; k < 6; ++k) frame.covariance[k][i] = s.covariance[k];
    frame.opacity[i] = s.opacity;
    frame.sh[i] = scene.sh[i].data();
  }
  return frame;
}

// The image pixel by pixel, and what became of each Gaussian in each pixel.
struct Account {
  std::vector<double> rgb = std::vector<double>(3 * kPixels, 0.0);
  std::vector<int> events;  // orders, clamps, and outcomes by pixel
  size_t cut = 0, finished = 0, clamped_slopes = 0, black = 0;
};

Account pixel_by_pixel(const Frame<double>& frame, const View<double>& view) {
  enum Outcome { kSkipped, kBlended, kCut, kFinished };
  Account out;
  struct Seen {
    size_t index;
    Splat<double> splat;
  };
  std::vector<Seen> seen;
  for (size_t i = 0; i < frame.count(); ++i) {
    Splat<double> splat;
    Projection<double> projection;
    if (!project(view, frame, i, &splat, &projection)) continue;
    shade(view, frame, i, &splat);
    for (const double c : splat.color) {
      out.events.push_back(c > 0);
      out.black += !(c > 0);
    }
    for (const bool clamped : projection.clamped) {
      out.events.push_back(clamped);
      out.clamped_slopes += clamped;
    }
    seen.push_back({i, splat});
  }
  std::sort(seen.begin(), seen.end(),
            [](const Seen& a, const Seen& b) { return a.splat.depth < b.splat.depth; });
  for (const Seen& s : seen) out.events.push_back(static_cast<int>(s.index));
  for (size_t p = 0; p < kPixels; ++p) {
    const size_t column = p % kWidth, row = p / kWidth;
    double transmittance = 1;
    for (const Seen& s : seen) {
      const double dx = static_cast<double>(column) + 0.5 - s.splat.mean[0];
      const double dy = static_cast<double>(row) + 0.5 - s.splat.mean[1];
      const double* k = s.splat.conic;
      double alpha =
          s.splat.opacity * std::exp(-(k[0] * dx * dx + 2 * k[1] * dx * dy + k[2] * dy * dy) / 2);
      Outcome outcome = alpha < kMinAlpha ? kSkipped : alpha > kMaxAlpha ? kCut : kBlended;
      alpha = std::min(alpha, kMaxAlpha);
      if (outcome != kSkipped && transmittance * (1 - alpha) < kMinTransmittance) {
        outcome = kFinished;
      }
      out.events.push_back(outcome);
      out.cut += outcome == kCut;
      if (outcome == kSkipped) continue;
      if (outcome == kFinished) {
        ++out.finished;
        break;
      }
      for (size_t c = 0; c < 3; ++c) {
        out.rgb[3 * p + c] += transmittance * alpha * s.splat.color[c];
      }
      transmittance *= 1 - alpha;
    }
    for (size_t c = 0; c < 3; ++c) {
      out.rgb[3 * p + c] += transmittance * static_cast<double>(kBackground[c]);
    }
  }
  return out;
}

std::vector<double> image_of(const Scene& scene) {
  std::vector<double> rgb(3 * kPixels);
  render_reference(slice(scene), make_test_view(), kBackground, rgb.data(), nullptr, nullptr);
  return rgb;
}

// Differences through the reference rasteriser by one number of the scene. The step is cut down
// until nothing changes its status within it.
template <typename Number>
double watched_derivative(const Scene& scene, const std::vector<float>& weight, double largest_step,
                          Number number, double* step) {
  const std::vector<int> events = pixel_by_pixel(slice(scene), make_test_view()).events;
  Scene moved = scene;
  auto& value = number(moved);
  const double start = static_cast<double>(value);
  using Float = std::remove_reference_t<decltype(value)>;
  const auto at = [&](double x) {
    value = static_cast<Float>(x);
    return slice(moved);
  };
  for (*step = largest_step; *step > 1e-4 * largest_step; *step /= 2) {
    bool same = true;
    for (int k = -3; k <= 3 && same; ++k) {
      same = pixel_by_pixel(at(start + k * *step), make_test_view()).events == events;
    }
    if (!same) continue;
    const auto scalar = [&](double x) {
      at(x);
      const std::vector<double> rgb = image_of(moved);
      double sum = 0;
      for (size_t k = 0; k < rgb.size(); ++k) sum += static_cast<double>(weight[k]) * rgb[k];
      return std::vector<double>{sum};
    };
    return differences::derivative(scalar, start, *step)[0];
  }
  ADD_FAILURE() << "a pixel is at a border";
  return 0;
}

struct SceneGradient {
  std::vector<Gradient4D<double>> gaussians;
  std::vector<std::vector<double>> sh;
};

SceneGradient backward(const Scene& scene, const std::vector<float>& weight) {
  const View<double> view = make_test_view();
  const Frame<double> frame = slice(scene);
  BackwardInput input;
  input.rgb_gradient = weight.data();
  ViewGradients<double> gradients;
  EXPECT_TRUE(make_reference_rasterizer(unlimited())
                  ->backward(frame, view, kBackground, input, &gradients, nullptr)
                  .ok());
  SceneGradient out;
  for (size_t i = 0; i < frame.count(); ++i) {
    Splat<double> splat;
    Projection<double> projection;
    EXPECT_TRUE(project(view, frame, i, &splat, &projection)) << i;
    SplatGradient3D<double> gradient;
    out.sh.emplace_back(scene.sh[i].size());
    project_gradient(view, frame, i, projection, gradients.splat[i], true, &gradient,
                     out.sh.back().data());
    out.gaussians.push_back(slice_gradient(scene.gaussians[i], scene.instant, gradient));
  }
  return out;
}

struct Totals {
  size_t cut = 0, finished = 0, clamped_slopes = 0, black = 0;
};

void check(const Scene& scene, Errors* errors, Totals* totals) {
  const Account account = pixel_by_pixel(slice(scene), make_test_view());
  totals->cut += account.cut;
  totals->finished += account.finished;
  totals->clamped_slopes += account.clamped_slopes;
  totals->black += account.black;
  const std::vector<double> rgb = image_of(scene);
  double size = 0;
  std::vector<float> weight;
  Random random(52);
  for (size_t k = 0; k < rgb.size(); ++k) {
    EXPECT_NEAR(rgb[k], account.rgb[k], 1e-13);
    weight.push_back(static_cast<float>(random.normal()));
    size += std::fabs(static_cast<double>(weight[k]) * rgb[k]);
  }
  const SceneGradient gradient = backward(scene, weight);

  for (size_t i = 0; i < kCount; ++i) {
    const auto compare = [&](const char* attribute, const double* analytic, size_t n,
                             double largest_step, auto number) {
      std::vector<double> numeric;
      double smallest_step = largest_step;
      for (size_t k = 0; k < n; ++k) {
        double step = 0;
        numeric.push_back(watched_derivative(
            scene, weight, largest_step, [&](Scene & s) -> auto& { return number(s, k); }, &step));
        smallest_step = std::min(smallest_step, step);
      }
      // Rounding of the sum, of which a difference is a small part.
      const double noise = std::numeric_limits<double>::epsilon() * size / smallest_step;
      errors->add(attribute, {analytic, analytic + n}, numeric, noise);
    };
    const Gradient4D<double>& g = gradient.gaussians[i];
    compare(
        "position", g.position, 3,
        2e-3, [i](Scene & s, size_t k) -> auto& { return s.gaussians[i].position[k]; });
    compare(
        "mean_t", &g.mean_t, 1,
        4e-3, [i](Scene & s, size_t) -> auto& { return s.gaussians[i].mean_t; });
    compare(
        "log_scale", g.log_scale, 4,
        4e-3, [i](Scene & s, size_t k) -> auto& { return s.gaussians[i].log_scale[k]; });
    const double* r = scene.gaussians[i].rotor;
    const double length = std::sqrt(dot4(r, r) + dot4(r + 4, r + 4));
    compare(
        "rotor", g.rotor, 8,
        1e-3 * length, [i](Scene & s, size_t k) -> auto& { return s.gaussians[i].rotor[k]; });
    compare(
        "opacity", &g.opacity, 1,
        1e-3, [i](Scene & s, size_t) -> auto& { return s.gaussians[i].opacity; });
    compare(
        "sh", gradient.sh[i].data(), gradient.sh[i].size(),
        0x1p-4, [i](Scene & s, size_t k) -> auto& { return s.sh[i][k]; });
  }
}

void check_scenes(const char* name, std::initializer_list<uint32_t> degrees, bool at_mean_time,
                  bool logit) {
  Errors errors;
  Totals totals;
  for (const uint32_t degree : degrees) {
    check(random_scene(60 + degree, degree, at_mean_time, logit), &errors, &totals);
  }
  errors.report(name, 1e-6);
  std::cout << "  cut " << totals.cut << ", finished pixels " << totals.finished
            << ", clamped slopes " << totals.clamped_slopes << ", clamped colours " << totals.black
            << "\n";
  EXPECT_GT(totals.cut, 0u);
  EXPECT_GT(totals.finished, 0u);
  EXPECT_GT(totals.clamped_slopes, 0u);
  EXPECT_GT(totals.black, 0u);
}

TEST(EndToEndGradient, PositionAtReferenceTime) {
  check_scenes("positions at the reference time, linear opacity", {0, 1, 3}, false, false);
}

TEST(EndToEndGradient, PositionAtMeanTimeAndLogits) {
  check_scenes("positions at the mean time, logits", {0, 2}, true, true);
}

}  // namespace
}  // namespace l4d::render
