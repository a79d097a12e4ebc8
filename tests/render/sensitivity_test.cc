// SPDX-License-Identifier: Apache-2.0
// Weights of Gaussians against what they are by definition.
#include "l4d/experimental/sensitivity.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "libl4dcodec/math/rotor.h"
#include "libl4dcodec/scene/sh.h"
#include "render/cpu/reference.h"
#include "render/frame/scene.h"
#include "tests/render/scenes.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

using test::Random;

constexpr uint32_t kWidth = 36, kHeight = 28;

struct TestView {
  double time;
  l4d_camera camera;
};

l4d_camera small_camera(double angle, uint32_t width = kWidth, uint32_t height = kHeight) {
  const double eye[3] = {5 * std::cos(angle), -0.5, 5 * std::sin(angle)};
  const double target[3] = {0, 0, 0};
  return call_on(width, height, 1.2 * width, eye, target);
}

std::vector<TestView> test_views() {
  return {{0.3, small_camera(0.2)},
          {0.3, small_camera(1.9)},
          {1.2, small_camera(0.9)},
          {1.7, small_camera(4.4, 24, 18)}};
}

// The last one is clamped to black from everywhere, the one before lies where no camera looks.
io::Scene test_scene(uint32_t degree = 2) {
  Random random(21);
  SceneBuilder builder(degree);
  for (int i = 0; i < 14; ++i) {
    const double rgb[3] = {random.uniform(0.3, 1), random.uniform(0.3, 1), random.uniform(0.3, 1)};
    const double scale[3] = {random.uniform(-2.5, -1), random.uniform(-2.5, -1),
                             random.uniform(-2.5, -1)};
    const size_t at = builder.add(0.6 * random.normal(), 0.5 * random.normal(),
                                  0.6 * random.normal(), scale, random.uniform(0.3, 0.9), rgb);
    builder.turn(at, random, i % 2 == 0 ? 0.05 : 0);
    io::Scene& scene = builder.scene();
    if (i % 3 == 0) scene.log_scale[4 * at + 3] = 0.5f;
    const size_t terms = 3 * scene.sh_coefficients();
    for (size_t k = 3; k < terms; ++k) scene.sh[terms * at + k] = random.uniformf(-0.1, 0.1);
  }
  const double red[3] = {1, 0, 0}, darker_than_black[3] = {-3, -3, -3};
  builder.add_ball(0, 60, 0, 0.2, 0.8, red);
  builder.add_ball(0.2, 0, 0.1, 0.15, 0.7, darker_than_black);
  return builder.scene();
}

RendererHandle renderer_of(const io::Scene& scene, uint32_t path = L4D_BACKEND_CPU,
                           uint32_t threads = 2) {
  RendererHandle r = make_renderer(path, threads);
  r.set_gaussians(scene.view(), scene.timeline);
  return r;
}

SensitivityHandle make_sensitivity(const io::Scene& scene, uint32_t metric = L4D_SENSITIVITY_SUM,
                                   uint64_t seed = 0) {
  l4d_sensitivity_options options = L4D_INIT(l4d_sensitivity_options);
  options.metric = metric;
  options.seed = seed;
  return {&options, scene.count(), scene.sh_degree};
}

void add_views(SensitivityHandle& s, RendererHandle& r, const std::vector<TestView>& views,
               bool visibility_only = false) {
  for (const TestView& v : views) {
    r.set_time(v.time);
    s.add_view(r, v.camera, visibility_only);
  }
}

double num_pixels(const std::vector<TestView>& views) {
  double n = 0;
  for (const TestView& v : views) n += static_cast<double>(v.camera.width) * v.camera.height;
  return n;
}

void expect_close(const std::vector<float>& actual, const std::vector<double>& expected,
                  double relative) {
  ASSERT_EQ(actual.size(), expected.size());
  const double largest = *std::max_element(expected.begin(), expected.end());
  EXPECT_GT(largest, 0);
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(static_cast<double>(actual[i]), expected[i],
                relative * (expected[i] + 0.01 * largest))
        << i;
  }
}

// Derivatives of the sum of pixels of one view, by the double reference.
struct Derivatives {
  std::vector<float> log_scale, rotor, position, opacity, mean_t;
  explicit Derivatives(const io::Scene& s)
      : log_scale(4 * s.count()),
        rotor(8 * s.count()),
        position(3 * s.count()),
        opacity(s.count()),
        mean_t(s.count()) {}
};
Derivatives derivatives(const io::Scene& scene, const RendererHandle& r, const l4d_camera& camera,
                        const std::vector<float>& gradient) {
  Derivatives out(scene);
  l4d_gradients g = L4D_INIT(l4d_gradients);
  g.count = scene.count();
  g.log_scale = out.log_scale.data();
  g.rotor = out.rotor.data();
  g.position = out.position.data();
  g.opacity = out.opacity.data();
  g.mean_t = out.mean_t.data();
  r.check(l4d_renderer_backward(r.get(), &camera, gradient.data(), &g));
  return out;
}

// max over the `count` numbers from `first` of each Gaussian.
std::vector<double> largest_of(const std::vector<double>& sums, size_t stride, size_t first,
                               size_t count, double pixels) {
  std::vector<double> out;
  for (size_t i = 0; i < sums.size(); i += stride) {
    double most = 0;
    for (size_t k = first; k < first + count; ++k) most = std::max(most, sums[i + k]);
    out.push_back(most / pixels);
  }
  return out;
}

TEST(Sensitivity, GeometryIsTheSumOfAbsoluteDerivatives) {
  const io::Scene scene = test_scene();
  const std::vector<TestView> views = test_views();
  RendererHandle reference = renderer_of(scene, L4D_BACKEND_REFERENCE);
  std::vector<double> scale, rotor, position, opacity, mean_t;
  const auto add = [](std::vector<double>& sums, const std::vector<float>& derivatives) {
    sums.resize(derivatives.size());
    for (size_t k = 0; k < sums.size(); ++k) {
      sums[k] += std::fabs(static_cast<double>(derivatives[k]));
    }
  };
  for (const TestView& v : views) {
    reference.set_time(v.time);
    const std::vector<float> ones(size_t{3} * v.camera.width * v.camera.height, 1.0f);
    const Derivatives d = derivatives(scene, reference, v.camera, ones);
    add(scale, d.log_scale);
    add(rotor, d.rotor);
    add(position, d.position);
    add(opacity, d.opacity);
    add(mean_t, d.mean_t);
  }
  const double pixels = num_pixels(views);
  for (const uint32_t path : {L4D_BACKEND_CPU, L4D_BACKEND_REFERENCE}) {
    RendererHandle r = renderer_of(scene, path);
    SensitivityHandle s = make_sensitivity(scene);
    add_views(s, r, views);
    expect_close(s.weights(L4D_WEIGHT_SCALE), largest_of(scale, 4, 0, 4, pixels), 1e-3);
    expect_close(s.weights(L4D_WEIGHT_ROTOR_SPATIAL), largest_of(rotor, 8, 0, 4, pixels), 1e-3);
    expect_close(s.weights(L4D_WEIGHT_ROTOR_TEMPORAL), largest_of(rotor, 8, 4, 4, pixels), 1e-3);
    expect_close(s.weights(L4D_WEIGHT_POSITION), largest_of(position, 3, 0, 3, pixels), 1e-3);
    expect_close(s.weights(L4D_WEIGHT_OPACITY), largest_of(opacity, 1, 0, 1, pixels), 1e-3);
    expect_close(s.weights(L4D_WEIGHT_MEAN_T), largest_of(mean_t, 1, 0, 1, pixels), 1e-3);
  }
}

// The same once more from images alone. A difference also sees the rim, where pixels start to
// count, which derivatives leave out.
TEST(Sensitivity, GeometryByDifferencesOfImages) {
  const io::Scene scene = test_scene(0);
  const std::vector<TestView> views = test_views();
  const auto sums = [&](const io::Scene& s) {
    RendererHandle r = renderer_of(s, L4D_BACKEND_REFERENCE);
    std::vector<double> out;
    for (const TestView& v : views) {
      r.set_time(v.time);
      double sum = 0;
      for (const float x : r.render(v.camera)) sum += static_cast<double>(x);
      out.push_back(sum);
    }
    return out;
  };
  const auto numbers = [&](std::vector<float> io::Scene::*attribute, float step) {
    std::vector<double> out((scene.*attribute).size());
    io::Scene moved = scene;
    for (size_t k = 0; k < out.size(); ++k) {
      float& x = (moved.*attribute)[k];
      const float kept = x;
      x = kept + step;
      const double above = static_cast<double>(x);
      const std::vector<double> high = sums(moved);
      x = kept - step;
      const double apart = above - static_cast<double>(x);
      const std::vector<double> low = sums(moved);
      x = kept;
      for (size_t v = 0; v < views.size(); ++v) out[k] += std::fabs(high[v] - low[v]) / apart;
    }
    return out;
  };
  RendererHandle r = renderer_of(scene);
  SensitivityHandle s = make_sensitivity(scene);
  add_views(s, r, views);
  const double pixels = num_pixels(views);
  const std::vector<double> scale = numbers(&io::Scene::log_scale, 0.02f);
  const std::vector<double> rotor = numbers(&io::Scene::rotor, 0.01f);
  expect_close(s.weights(L4D_WEIGHT_SCALE), largest_of(scale, 4, 0, 4, pixels), 0.2);
  expect_close(s.weights(L4D_WEIGHT_ROTOR_SPATIAL), largest_of(rotor, 8, 0, 4, pixels), 0.2);
  expect_close(s.weights(L4D_WEIGHT_ROTOR_TEMPORAL), largest_of(rotor, 8, 4, 4, pixels), 0.2);
}

TEST(Sensitivity, ShAndCoverage) {
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    const io::Scene scene = test_scene(degree);
    const std::vector<TestView> views = test_views();
    Scene prepared;
    ASSERT_TRUE(prepared.prepare(scene.view(), scene.timeline, 1, unlimited()).ok());
    const size_t terms = sh_terms(degree);
    std::vector<double> sh(terms * scene.count()), covered(scene.count());
    const float black[3] = {0, 0, 0};
    for (const TestView& v : views) {
      Frame<double> frame;
      EXPECT_TRUE(prepared.slice(v.time, unlimited(), &frame).ok());
      const View<double> view = make_view<double>(v.camera);
      ViewGradients<double> g;
      EXPECT_TRUE(make_reference_rasterizer(unlimited())
                      ->backward(frame, view, black, BackwardInput(), &g, nullptr)
                      .ok());
      for (size_t i = 0; i < frame.count(); ++i) {
        const double position[3] = {frame.position[0][i], frame.position[1][i],
                                    frame.position[2][i]};
        double direction[3], basis[kMaxShTerms];
        view_direction(view, position, direction);
        sh_basis(degree, direction[0], direction[1], direction[2], basis);
        for (size_t k = 0; k < terms; ++k) {
          sh[terms * frame.id[i] + k] += g.coverage[i] * std::fabs(basis[k]);
        }
        covered[frame.id[i]] += g.coverage[i];
      }
    }
    const double pixels = num_pixels(views);
    for (double& c : covered) c /= pixels;
    RendererHandle r = renderer_of(scene);
    SensitivityHandle s = make_sensitivity(scene);
    add_views(s, r, views);
    const std::vector<float> weights = s.weights(L4D_WEIGHT_SH);
    expect_close(weights, largest_of(sh, terms, 0, terms, pixels), 1e-4);
    expect_close(s.weights(L4D_WEIGHT_ALPHA_T), covered, 1e-4);
    // Black as it is, it hides what lies behind; what nobody sees has no weight.
    EXPECT_GT(weights.back(), 0);
    EXPECT_EQ(weights[weights.size() - 2], 0);
    EXPECT_EQ(s.weights(L4D_WEIGHT_ALPHA_T)[weights.size() - 2], 0);
  }
}

TEST(Sensitivity, ThreadsDoNotChangeBits) {
  const io::Scene scene = synth(9000, 2);
  for (const uint32_t metric : {L4D_SENSITIVITY_SUM, L4D_SENSITIVITY_GAUSS_NEWTON}) {
    std::vector<std::vector<float>> first;
    for (const uint32_t threads : {1u, 2u, 7u}) {
      RendererHandle r = renderer_of(scene, L4D_BACKEND_CPU, threads);
      SensitivityHandle s = make_sensitivity(scene, metric, 5);
      add_views(s, r, {{0.5, ring_camera(100, 70, 1)}, {2, ring_camera(90, 70, 3)}});
      add_views(s, r, {{1.5, ring_camera(100, 70, 5)}}, true);
      for (uint32_t which = 0; which < L4D_WEIGHT_COUNT; ++which) {
        if (threads == 1) {
          first.push_back(s.weights(which));
        } else {
          EXPECT_TRUE(equal_bits(first[which], s.weights(which))) << which;
        }
      }
    }
  }
}

// Views that are only asked count for what nothing else shows.
TEST(Sensitivity, VisibilityOnlyViews) {
  const double red[3] = {1, 0, 0};
  SceneBuilder builder;
  builder.add_ball(0, 0, 4, 0.2, 0.8, red);
  builder.add_ball(0, 0, -4, 0.2, 0.8, red);
  builder.add_ball(60, 0, 0, 0.2, 0.8, red);
  const io::Scene& scene = builder.scene();
  RendererHandle r = renderer_of(scene);
  r.set_time(0);
  const double eye[3] = {0, 0, 0}, back[3] = {0, 0, -1};
  const l4d_camera front_camera = axis_camera(32, 24, 30);
  const l4d_camera back_camera = call_on(32, 24, 30, eye, back);
  SensitivityHandle s = make_sensitivity(scene), both = make_sensitivity(scene);
  s.add_view(r, back_camera, true);
  std::vector<float> out(3);
  EXPECT_EQ(l4d_sensitivity_get_weights(s.get(), L4D_WEIGHT_ALPHA_T, out.data(), 3),
            L4D_ERR_INVALID_STATE);
  s.add_view(r, front_camera);
  s.add_view(r, front_camera, true);
  both.add_view(r, front_camera);
  both.add_view(r, back_camera);
  const std::vector<float> alpha = s.weights(L4D_WEIGHT_ALPHA_T);
  const std::vector<float> full = both.weights(L4D_WEIGHT_ALPHA_T);
  EXPECT_NEAR(alpha[0], 2 * full[0], 1e-6f);      // of the one full view
  EXPECT_NEAR(3 * alpha[1], 2 * full[1], 1e-6f);  // of all three
  EXPECT_GT(alpha[1], 0);
  EXPECT_EQ(alpha[2], 0);
  EXPECT_EQ(s.weights(L4D_WEIGHT_SCALE)[1], 0);
  EXPECT_GT(both.weights(L4D_WEIGHT_SCALE)[1], 0);
}

// What Gauss-Newton weights estimate: of every number of the attribute the squared differences of
// all pixels and channels, for a scene as streams code it.
class Differences {
 public:
  Differences(const io::Scene& scene, const std::vector<TestView>& views)
      : scene_(scene), views_(views) {}

  std::vector<double> weights(std::vector<float> io::Scene::*attribute, size_t stride, size_t first,
                              size_t count) {
    std::vector<double> out;
    for (size_t i = 0; i < scene_.count(); ++i) {
      double squares = 0;
      for (size_t k = first; k < first + count; ++k) {
        squares += squared_derivative(&(scene_.*attribute)[stride * i + k]);
      }
      out.push_back(std::sqrt(squares / static_cast<double>(count) / num_pixels(views_)));
    }
    return out;
  }

 private:
  // So small that hardly a pixel crosses a threshold, where images jump.
  static constexpr float kStep = 1e-4f;

  std::vector<double> images() const {
    Scene prepared;
    EXPECT_TRUE(prepared.prepare(scene_.view(), scene_.timeline, 1, unlimited()).ok());
    const float black[3] = {0, 0, 0};
    std::vector<double> out;
    for (const TestView& v : views_) {
      Frame<double> frame;
      EXPECT_TRUE(prepared.slice(v.time, unlimited(), &frame).ok());
      std::vector<double> rgb(size_t{3} * v.camera.width * v.camera.height);
      render_reference(frame, make_view<double>(v.camera), black, rgb.data(), nullptr, nullptr);
      out.insert(out.end(), rgb.begin(), rgb.end());
    }
    return out;
  }

  double squared_derivative(float* number) {
    const float kept = *number;
    *number = kept + kStep;
    double apart = static_cast<double>(*number);
    const std::vector<double> high = images();
    *number = kept - kStep;
    apart -= static_cast<double>(*number);
    const std::vector<double> low = images();
    *number = kept;
    double sum = 0;
    for (size_t k = 0; k < high.size(); ++k) sum += std::pow((high[k] - low[k]) / apart, 2);
    return sum;
  }

  io::Scene scene_;
  std::vector<TestView> views_;
};

// Adding views again and again, each time with other signs, averages the estimate.
TEST(Sensitivity, GaussNewtonIsTheSquaredDifferenceOfPixels) {
  io::Scene coded = test_scene(1);
  for (size_t i = 0; i < coded.count(); ++i) {
    coded.mean_t[i] = i % 4 == 0 ? -0.7f : i % 4 == 1 ? 2.6f : 1.1f;
    normalize_rotor(coded.rotor.data() + 8 * i, coded.rotor.data() + 8 * i);
  }
  // The same as training leaves it. What is measured does not depend on how it is written down.
  io::Scene given = coded;
  io::positions_to_mean_time(given);
  io::opacity_to_logit(given);
  for (float& x : given.rotor) x *= 2.5f;

  const std::vector<TestView> views = {{0.3, small_camera(0.2, 9, 7)},
                                       {1.7, small_camera(2.9, 8, 6)}};
  Differences by(coded, views);
  struct Kind {
    uint32_t which;
    std::vector<double> expected;
  };
  const std::vector<Kind> kinds = {
      {L4D_WEIGHT_SH, by.weights(&io::Scene::sh, 12, 0, 12)},
      {L4D_WEIGHT_SCALE, by.weights(&io::Scene::log_scale, 4, 0, 4)},
      {L4D_WEIGHT_ROTOR_SPATIAL, by.weights(&io::Scene::rotor, 8, 0, 4)},
      {L4D_WEIGHT_ROTOR_TEMPORAL, by.weights(&io::Scene::rotor, 8, 4, 4)},
      {L4D_WEIGHT_POSITION, by.weights(&io::Scene::position, 3, 0, 3)},
      {L4D_WEIGHT_OPACITY, by.weights(&io::Scene::opacity, 1, 0, 1)},
      {L4D_WEIGHT_MEAN_T, by.weights(&io::Scene::mean_t, 1, 0, 1)}};
  for (const io::Scene* scene : {&coded, &given}) {
    RendererHandle r = renderer_of(*scene, L4D_BACKEND_CPU, 1);
    SensitivityHandle s = make_sensitivity(*scene, L4D_SENSITIVITY_GAUSS_NEWTON, 7);
    for (const TestView& v : views) {
      r.set_time(v.time);
      for (int i = 0; i < 4000; ++i) s.add_view(r, v.camera);
    }
    for (const Kind& kind : kinds) {
      SCOPED_TRACE(kind.which);
      std::vector<float> weights = s.weights(kind.which);
      std::vector<double> expected = kind.expected;
      if (kind.which == L4D_WEIGHT_SH) {
        // Of a colour that is clamped images show nothing; the weight is that without the clamp.
        EXPECT_EQ(expected.back(), 0);
        EXPECT_GT(weights.back(), 0);
        weights.pop_back();
        expected.pop_back();
      }
      expect_close(weights, expected, 0.05);  // four standard errors of the root
    }
  }
}

TEST(Sensitivity, SignsComeFromTheSeed) {
  const io::Scene scene = test_scene(1);
  const l4d_camera camera = small_camera(0.2, 9, 7);
  RendererHandle r = renderer_of(scene);
  r.set_time(0.3);
  SensitivityHandle one = make_sensitivity(scene, L4D_SENSITIVITY_GAUSS_NEWTON, 7),
                    same = make_sensitivity(scene, L4D_SENSITIVITY_GAUSS_NEWTON, 7),
                    other = make_sensitivity(scene, L4D_SENSITIVITY_GAUSS_NEWTON, 8);
  for (SensitivityHandle* h : {&one, &same, &other}) h->add_view(r, camera);
  EXPECT_EQ(one.weights(L4D_WEIGHT_SCALE), same.weights(L4D_WEIGHT_SCALE));
  EXPECT_NE(one.weights(L4D_WEIGHT_SCALE), other.weights(L4D_WEIGHT_SCALE));
}

TEST(Sensitivity, WrongStates) {
  const io::Scene scene = test_scene();
  const l4d_camera camera = small_camera(0);
  RendererHandle r = make_renderer(L4D_BACKEND_CPU);
  SensitivityHandle s = make_sensitivity(scene);
  const auto add = [&] { return l4d_sensitivity_add_view(s.get(), r.get(), &camera, 0); };
  EXPECT_EQ(add(), L4D_ERR_INVALID_STATE);  // no scene
  r.set_gaussians(scene.view(), scene.timeline);
  EXPECT_EQ(add(), L4D_ERR_INVALID_STATE);  // no time
  r.set_time(0);
  const float grey[3] = {0.5f, 0.5f, 0.5f}, black[3] = {0, 0, 0};
  r.check(l4d_renderer_set_background(r.get(), grey));
  EXPECT_EQ(add(), L4D_ERR_INVALID_STATE);
  EXPECT_NE(std::string(l4d_last_error_message()).find("background"), std::string::npos);
  r.check(l4d_renderer_set_background(r.get(), black));
  EXPECT_EQ(add(), L4D_OK);
  const io::Scene other = test_scene(1);
  r.set_gaussians(other.view(), other.timeline);
  r.set_time(0);
  EXPECT_EQ(add(), L4D_ERR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace l4d::render
