// SPDX-License-Identifier: Apache-2.0
// Gradients and importances of the device against those of the reference.
#include "l4d/experimental/sensitivity.hpp"
#include "tests/gpu/render_support.h"

namespace l4d::render {
namespace {

using test::Random;

constexpr const char* kArrays[6] = {"position", "mean_t", "log_scale", "rotor", "opacity", "sh"};

struct Gradients {
  std::vector<float> array[6];
  std::vector<double> view;
};

Gradients gradients_of(const RendererHandle& renderer, const io::Scene& scene,
                       const l4d_camera& camera, const std::vector<float>& upstream) {
  const size_t n = scene.count();
  const size_t width[6] = {3, 1, 4, 8, 1, 3 * scene.sh_coefficients()};
  Gradients out;
  // The call adds.
  for (size_t k = 0; k < 6; ++k) out.array[k].assign(n * width[k], 0.5f);
  out.view.assign(9, 0);
  l4d_gradients g = L4D_INIT(l4d_gradients);
  g.count = n;
  g.position = out.array[0].data();
  g.mean_t = out.array[1].data();
  g.log_scale = out.array[2].data();
  g.rotor = out.array[3].data();
  g.opacity = out.array[4].data();
  g.sh = out.array[5].data();
  g.view = out.view.data();
  renderer.check(l4d_renderer_backward(renderer.get(), &camera, upstream.data(), &g));
  for (auto& array : out.array) {
    for (float& v : array) v -= 0.5f;
  }
  return out;
}

// Weights that hold large and small numbers, cancel and do not.
std::vector<float> upstream_of(const l4d_camera& camera, uint64_t seed) {
  Random random(seed);
  std::vector<float> out(size_t{3} * camera.width * camera.height);
  for (float& v : out) v = random.uniformf(-1, 2);
  return out;
}

void compare(const std::string& name, const io::Scene& scene, const l4d_camera& camera,
             double time) {
  const RendererHandle expected = make_renderer(L4D_BACKEND_REFERENCE), device = make_device();
  const l4d_gaussians gaussians = scene.view();
  const float background[3] = {0.2f, 0.1f, 0.4f};
  for (const RendererHandle* r : {&expected, &device}) {
    r->check(l4d_renderer_set_gaussians(r->get(), &gaussians, &scene.timeline));
    r->check(l4d_renderer_set_background(r->get(), background));
    r->check(l4d_renderer_set_time(r->get(), time));
  }
  const std::vector<float> upstream = upstream_of(camera, 5);
  const Gradients e = gradients_of(expected, scene, camera, upstream);
  const Gradients d = gradients_of(device, scene, camera, upstream);
  const Gradients again = gradients_of(device, scene, camera, upstream);
  for (size_t k = 0; k < 6; ++k) {
    double size = 0;
    for (const float v : e.array[k]) size = std::max(size, std::fabs(static_cast<double>(v)));
    EXPECT_GT(size, 0) << name << ", " << kArrays[k];
    const double distance = relative_distance(d.array[k], e.array[k]);
    std::cout << name << ", " << kArrays[k] << ": relative distance " << distance << "\n";
    EXPECT_LT(distance, 2e-3) << name << ", " << kArrays[k];
    EXPECT_TRUE(equal_bits(d.array[k], again.array[k])) << name << ", " << kArrays[k];
  }
  // Each of them is what much of both signs leaves.
  for (size_t k = 0; k < e.view.size(); ++k) {
    EXPECT_NE(e.view[k], 0) << name << ", view " << k;
    EXPECT_NEAR(d.view[k], e.view[k], 1e-2 * std::abs(e.view[k])) << name << ", view " << k;
  }
  EXPECT_EQ(d.view, again.view) << name;
}

TEST(DeviceGradient, EveryDegreeIsTheReference) {
  L4D_SKIP_WITHOUT_DEVICE();
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    compare("degree " + std::to_string(degree), with_degree(synth(6000, 2), degree),
            ring_camera(131, 97, 0.8), 1.1);
  }
}

TEST(DeviceGradient, LogitsAndMeanTimes) {
  L4D_SKIP_WITHOUT_DEVICE();
  io::Scene scene = synth(4000, 5);
  io::opacity_to_logit(scene);
  io::positions_to_mean_time(scene);
  compare("logits and mean times", scene, ring_camera(101, 87, 2.8), 2.1);
}

TEST(DeviceGradient, FlatWindows) {
  L4D_SKIP_WITHOUT_DEVICE();
  io::Scene scene = with_windows(synth(20000, 6));
  compare("windows", scene, ring_camera(101, 87, 2.8), 1.1);
  io::positions_to_mean_time(scene);
  compare("windows and mean times", scene, ring_camera(101, 87, 0.8), 2.1);
}

// Splats of many tiles go another way through the sums.
TEST(DeviceGradient, LargeSplats) {
  L4D_SKIP_WITHOUT_DEVICE();
  Random random(8);
  SceneBuilder builder(2);
  for (int i = 0; i < 40; ++i) {
    const double rgb[3] = {random.uniform(0.2, 1), random.uniform(0.2, 1), random.uniform(0.2, 1)};
    const double scale[3] = {random.uniform(-2, 0.5), random.uniform(-2, 0.5),
                             random.uniform(-2, 0.5)};
    const size_t at = builder.add(random.normal(), random.normal(), 5 + random.normal(), scale,
                                  random.uniform(0.05, 0.6), rgb);
    builder.turn(at, random, 0.1);
    builder.scene().log_scale[4 * at + 3] = 0.3f;
  }
  compare("large splats", builder.scene(), axis_camera(300, 260, 240), 0.9);
}

struct Weights {
  std::vector<float> array[L4D_WEIGHT_COUNT];
};

struct TestView {
  double time;
  double angle;
  bool visibility_only;
};

Weights weights_of(const SensitivityHandle& sums) {
  Weights out;
  for (uint32_t k = 0; k < L4D_WEIGHT_COUNT; ++k) out.array[k] = sums.weights(k);
  return out;
}

SensitivityHandle measured(const RendererHandle& renderer, const io::Scene& scene, uint32_t metric,
                           const std::vector<TestView>& views) {
  l4d_sensitivity_options options = L4D_INIT(l4d_sensitivity_options);
  options.metric = metric;
  options.seed = 77;
  SensitivityHandle sums(&options, scene.count(), scene.sh_degree);
  for (const TestView& v : views) {
    renderer.check(l4d_renderer_set_time(renderer.get(), v.time));
    sums.add_view(renderer, ring_camera(140, 100, v.angle), v.visibility_only);
  }
  return sums;
}

const std::vector<TestView> kViews = {
    {0.4, 0.3, false}, {0.4, 2.2, false}, {1.5, 4.0, false}, {3.1, 1.0, true}, {3.1, 5.0, true}};

TEST(DeviceImportance, IsTheReference) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(6000, 4);
  const l4d_gaussians gaussians = scene.view();
  const RendererHandle expected = make_renderer(L4D_BACKEND_REFERENCE), device = make_device();
  for (const RendererHandle* r : {&expected, &device}) {
    r->check(l4d_renderer_set_gaussians(r->get(), &gaussians, &scene.timeline));
  }
  for (const uint32_t metric : {L4D_SENSITIVITY_SUM, L4D_SENSITIVITY_GAUSS_NEWTON}) {
    const Weights e = weights_of(measured(expected, scene, metric, kViews));
    const Weights d = weights_of(measured(device, scene, metric, kViews));
    for (uint32_t k = 0; k < L4D_WEIGHT_COUNT; ++k) {
      const double distance = relative_distance(d.array[k], e.array[k]);
      std::cout << "measure " << metric << ", weight " << k << ": relative distance " << distance
                << "\n";
      EXPECT_LT(distance, 2e-3) << "measure " << metric << ", weight " << k;
      size_t unlike = 0;
      for (size_t i = 0; i < scene.count(); ++i) {
        unlike += (d.array[L4D_WEIGHT_ALPHA_T][i] > 0) != (e.array[L4D_WEIGHT_ALPHA_T][i] > 0);
      }
      EXPECT_LE(unlike, scene.count() / 500) << "seen by one alone";
    }
  }
}

// In whatever order views are added, the sums are the same.
TEST(DeviceImportance, DoesNotDependOnTheOrderOfViews) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(6000, 4);
  const l4d_gaussians gaussians = scene.view();
  const RendererHandle device = make_device();
  device.check(l4d_renderer_set_gaussians(device.get(), &gaussians, &scene.timeline));
  const std::vector<TestView> full(kViews.begin(), kViews.begin() + 3);
  for (const uint32_t metric : {L4D_SENSITIVITY_SUM, L4D_SENSITIVITY_GAUSS_NEWTON}) {
    const Weights one = weights_of(measured(device, scene, metric, full));
    const Weights two = weights_of(measured(device, scene, metric, {full[2], full[1], full[0]}));
    for (uint32_t k = 0; k < L4D_WEIGHT_COUNT; ++k) {
      EXPECT_TRUE(equal_bits(one.array[k], two.array[k]))
          << "measure " << metric << ", weight " << k;
    }
  }
}

// All of `count` cameras on a ring at each of the times.
struct RingViews {
  std::vector<l4d_camera> cameras;
  std::vector<l4d_view> views;
};
RingViews ring_views(uint32_t width, uint32_t height, uint32_t count, int times, double step) {
  RingViews out;
  for (uint32_t c = 0; c < count; ++c) out.cameras.push_back(ring_camera(width, height, c));
  for (int t = 0; t < times; ++t) {
    for (uint32_t c = 0; c < count; ++c) out.views.push_back({step * t, c, 0});
  }
  return out;
}

TEST(DeviceImportance, MeasuresWithL4dMeasure) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(3000, 6);
  const l4d_gaussians gaussians = scene.view();
  const RendererHandle expected = make_renderer(L4D_BACKEND_CPU), device = make_device();
  const auto [cameras, views] = ring_views(90, 70, 6, 4, 0.9);
  l4d_measure_options options = L4D_INIT(l4d_measure_options);
  options.max_share = 0.5;
  uint64_t unseen[2] = {};
  size_t which = 0;
  for (const RendererHandle* r : {&expected, &device}) {
    r->check(l4d_renderer_set_gaussians(r->get(), &gaussians, &scene.timeline));
    l4d_measure_report report = L4D_INIT(l4d_measure_report);
    float* const none[L4D_WEIGHT_COUNT] = {};
    r->check(l4d_measure_importance(r->get(), cameras.data(), 6, views.data(), views.size(),
                                    &options, none, scene.count(), &report));
    EXPECT_GT(report.views_measured, 0u);
    unseen[which++] = report.unseen;
  }
  EXPECT_LT(unseen[0], scene.count());
  EXPECT_NEAR(static_cast<double>(unseen[1]), static_cast<double>(unseen[0]), 10);
}

// l4d_measure_importance has two views under way at a time, with more instances than fit
// at first, and adds them up as one by one.
TEST(DeviceImportance, ViewsUnderWayTogetherAddUpAsOneByOne) {
  L4D_SKIP_WITHOUT_DEVICE();
  io::Scene scene = synth(40000, 6);
  for (size_t i = 0; i < scene.count(); i += 8) scene.log_scale[4 * i] = 1.0f;
  const l4d_gaussians gaussians = scene.view();
  const RendererHandle device = make_device();
  device.check(l4d_renderer_set_gaussians(device.get(), &gaussians, &scene.timeline));
  const auto [cameras, views] = ring_views(800, 600, 5, 9, 0.4);
  l4d_measure_options options = L4D_INIT(l4d_measure_options);
  options.metric = L4D_SENSITIVITY_SUM;  // without signs, which are others in each half
  options.agreement = 2;
  const l4d_sensitivity_options sums = {sizeof(l4d_sensitivity_options), options.metric, 0,
                                        options.seed};
  SensitivityHandle one_by_one(&sums, scene.count(), scene.sh_degree);
  for (const l4d_view& v : views) {
    device.check(l4d_renderer_set_time(device.get(), v.time));
    one_by_one.add_view(device, cameras[v.camera], false);
  }
  const Weights expected = weights_of(one_by_one);
  for (int round = 0; round < 3; ++round) {
    Weights found;
    float* to[L4D_WEIGHT_COUNT];
    for (uint32_t k = 0; k < L4D_WEIGHT_COUNT; ++k) {
      found.array[k].resize(scene.count());
      to[k] = found.array[k].data();
    }
    device.check(l4d_measure_importance(device.get(), cameras.data(), 5, views.data(), views.size(),
                                        &options, to, scene.count(), nullptr));
    for (uint32_t k = 0; k < L4D_WEIGHT_COUNT; ++k) {
      EXPECT_TRUE(equal_bits(expected.array[k], found.array[k])) << round << ", weight " << k;
    }
    // A scene set again takes its views with it.
    device.check(l4d_renderer_set_gaussians(device.get(), &gaussians, &scene.timeline));
  }
}

}  // namespace
}  // namespace l4d::render
