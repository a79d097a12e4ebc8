// SPDX-License-Identifier: Apache-2.0
// Gradients of the fast path against the double reference.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <string>
#include <vector>

#include "io/camera/cameras.h"
#include "io/ply/scene_ply.h"
#include "render/cpu/fast/fast.h"
#include "render/cpu/reference.h"
#include "render/frame/scene.h"
#include "tests/common/files.h"
#include "tests/render/scenes.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

using test::Random;

constexpr float kBlack[3] = {0, 0, 0};

// Two arrays of derivatives by one attribute.
struct Error {
  double largest = 0;   // difference, over the largest derivative
  double relative = 0;  // norm of the differences over the norm
};

template <typename A, typename B>
Error error_of(const std::vector<A>& actual, const std::vector<B>& expected) {
  EXPECT_EQ(actual.size(), expected.size());
  double largest = 0, difference = 0, squares = 0, all = 0;
  for (size_t k = 0; k < expected.size(); ++k) {
    const double a = static_cast<double>(actual[k]), e = static_cast<double>(expected[k]);
    EXPECT_TRUE(std::isfinite(a)) << k;
    largest = std::max(largest, std::fabs(e));
    difference = std::max(difference, std::fabs(a - e));
    squares += (a - e) * (a - e);
    all += e * e;
  }
  if (largest == 0) return {difference == 0 ? 0.0 : INFINITY, difference == 0 ? 0.0 : INFINITY};
  return {difference / largest, std::sqrt(squares / all)};
}

std::vector<float> random_gradient(const l4d_camera& camera, uint64_t seed = 11) {
  Random random(seed);
  std::vector<float> out(size_t{3} * camera.width * camera.height);
  for (float& g : out) g = static_cast<float>(random.normal());
  return out;
}

// ---- of splats ---------------------------------------------------------------------------------

// Attributes of splats as arrays.
template <typename T>
std::vector<std::vector<T>> columns(const ViewGradients<T>& g) {
  std::vector<std::vector<T>> out(5);
  for (size_t i = 0; i < g.splat.size(); ++i) {
    const SplatGradient2D<T>& s = g.splat[i];
    out[0].insert(out[0].end(), s.mean, s.mean + 2);
    out[1].insert(out[1].end(), s.conic, s.conic + 3);
    out[2].push_back(s.opacity);
    out[3].insert(out[3].end(), s.color, s.color + 3);
    out[4].push_back(g.coverage[i]);
  }
  return out;
}

struct Instants {
  Scene scene;
  Frame<float> frame;
  Frame<double> wide;
  Instants(const io::Scene& from, double time) {
    EXPECT_TRUE(scene.prepare(from.view(), from.timeline, 2, unlimited()).ok());
    EXPECT_TRUE(scene.slice(time, 2, unlimited(), &frame).ok());
    EXPECT_TRUE(widen(frame, unlimited(), &wide).ok());
  }
};

ViewGradients<float> fast_backward(const Frame<float>& frame, const l4d_camera& camera,
                                   const BackwardInput& input, const float* background = kBlack,
                                   int threads = 2) {
  ViewGradients<float> out;
  Stats stats;
  EXPECT_TRUE(make_fast_rasterizer(threads, false, unlimited())
                  ->backward(frame, make_view<float>(camera), background, input, &out, &stats)
                  .ok());
  return out;
}

void check_splats(const char* name, const io::Scene& scene, const l4d_camera& camera,
                  double largest, double relative) {
  const Instants at(scene, 1.1);
  const std::vector<float> gradient = random_gradient(camera);
  const float background[3] = {0.3f, 0.1f, 0.6f};
  const char* attributes[] = {"mean", "conic", "opacity", "color", "coverage"};
  for (const bool given : {false, true}) {
    BackwardInput input;
    input.rgb_gradient = given ? gradient.data() : nullptr;
    ViewGradients<double> expected;
    EXPECT_TRUE(
        make_reference_rasterizer(unlimited())
            ->backward(at.wide, make_view<double>(camera), background, input, &expected, nullptr)
            .ok());
    const auto a = columns(fast_backward(at.frame, camera, input, background));
    const auto e = columns(expected);
    std::cout << name << (given ? ", random gradient:" : ", sum of pixels:");
    for (size_t k = 0; k < e.size(); ++k) {
      const Error error = error_of(a[k], e[k]);
      std::cout << " " << attributes[k] << " " << error.largest << " (" << error.relative << ")";
      EXPECT_LT(error.largest, largest) << name << ", " << attributes[k];
      EXPECT_LT(error.relative, relative) << name << ", " << attributes[k];
    }
    std::cout << "\n";
  }
}

io::Scene blobs(size_t count, double low, double high, double opacity_from, double speed,
                uint32_t degree = 1) {
  Random random(9);
  SceneBuilder builder(degree);
  for (size_t i = 0; i < count; ++i) {
    const double rgb[3] = {random.uniform(-0.2, 1), random.uniform(), random.uniform()};
    const double scale[3] = {random.uniform(low, high), random.uniform(low, high),
                             random.uniform(low, high)};
    const size_t at = builder.add(random.normal(), random.normal(), 4 + random.normal(), scale,
                                  random.uniform(opacity_from, 1), rgb);
    builder.turn(at, random, speed);
    io::Scene& scene = builder.scene();
    if (i % 2 == 0) scene.log_scale[4 * at + 3] = random.uniformf(-1, 3);
    const size_t terms = 3 * scene.sh_coefficients();
    for (size_t k = 3; k < terms; ++k) scene.sh[terms * at + k] = random.uniformf(-0.3, 0.3);
  }
  return builder.scene();
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

TEST(FastBackward, DerivativesOfSplats) {
  check_splats("synthetic", synth(8000), ring_camera(161, 97, 1), 5e-3, 1e-3);
  check_splats("blobs", blobs(500, -4, -1, 0.05, 0.05), axis_camera(120, 77, 100), 1e-3, 1e-3);
  check_splats("opaque blobs", blobs(300, -2, 0, 0.99, 0), axis_camera(64, 48, 50), 1e-2, 5e-3);
  check_splats("needles", needles(1e6, 0.2), axis_camera(200, 150, 180), 1e-2, 5e-3);
}

// The sum of all pixels is the short form of ones given pixel by pixel.
TEST(FastBackward, UpstreamForms) {
  const io::Scene scene = blobs(400, -4, -1, 0.05, 0.05);
  const Instants at(scene, 1);
  const l4d_camera camera = axis_camera(75, 43, 70);
  const size_t pixels = size_t{75} * 43;
  std::vector<float> ones(3 * pixels, 1.0f), signs(3 * pixels);
  for (size_t k = 0; k < signs.size(); ++k) signs[k] = k * 7 % 5 < 2 ? -1.0f : 1.0f;
  const auto run = [&](const float* gradient) {
    BackwardInput input;
    input.rgb_gradient = gradient;
    return columns(fast_backward(at.frame, camera, input));
  };
  const auto plain = run(nullptr), given = run(ones.data()), signed_sum = run(signs.data());
  for (size_t k = 0; k < plain.size(); ++k) {
    EXPECT_LT(error_of(plain[k], given[k]).largest, 1e-4) << k;
  }
  EXPECT_GT(error_of(plain[0], signed_sum[0]).largest, 0.1);
}

TEST(FastBackward, CoverageAndTheSeenMask) {
  const io::Scene scene = synth(6000, 8);
  const Instants at(scene, 2);
  const l4d_camera camera = ring_camera(133, 90, 2);
  const size_t pixels = size_t{133} * 90;
  std::vector<float> alpha(pixels);
  Stats stats;
  const auto rasterizer = make_fast_rasterizer(2, false, unlimited());
  const View<float> view = make_view<float>(camera);
  EXPECT_TRUE(rasterizer->forward(at.frame, view, kBlack, nullptr, alpha.data(), &stats).ok());
  double total = 0, covered = 0;
  for (const float a : alpha) total += static_cast<double>(a);
  const ViewGradients<float> all = fast_backward(at.frame, camera, BackwardInput());
  for (const float c : all.coverage) covered += static_cast<double>(c);
  EXPECT_NEAR(covered, total, 1e-5 * total);

  BackwardInput input;
  input.geometry = false;
  const ViewGradients<float> only = fast_backward(at.frame, camera, input);
  EXPECT_TRUE(only.splat.empty());
  EXPECT_LT(error_of(only.coverage, all.coverage).largest, 1e-6);
  // Every third Gaussian of the scene has been seen: the others' coverage is what it was.
  std::vector<uint8_t> seen(scene.count());
  for (size_t i = 0; i < seen.size(); i += 3) seen[i] = 1;
  input.seen = seen.data();
  const ViewGradients<float> masked = fast_backward(at.frame, camera, input);
  size_t asked = 0;
  for (size_t i = 0; i < at.frame.count(); ++i) {
    if (seen[at.frame.id[i]] != 0) continue;
    asked += masked.coverage[i] > 0;
    EXPECT_EQ(masked.coverage[i], only.coverage[i]) << i;
  }
  EXPECT_GT(asked, 500u);
  std::fill(seen.begin(), seen.end(), uint8_t{1});
  for (const float c : fast_backward(at.frame, camera, input).coverage) EXPECT_EQ(c, 0);
}

// ---- of the scene, through the C API -----------------------------------------------------------

constexpr const char* kAttributes[] = {"position", "mean_t", "log_scale", "rotor", "opacity", "sh"};

struct Gradients {
  std::vector<std::vector<float>> arrays;
  l4d_gradients g;
  explicit Gradients(const io::Scene& scene, float start = 0) {
    const size_t n = scene.count();
    for (const size_t size : {3 * n, n, 4 * n, 8 * n, n, scene.sh.size()}) {
      arrays.emplace_back(size, start);
    }
    g = L4D_INIT(l4d_gradients);
    g.count = n;
    g.position = arrays[0].data();
    g.mean_t = arrays[1].data();
    g.log_scale = arrays[2].data();
    g.rotor = arrays[3].data();
    g.opacity = arrays[4].data();
    g.sh = arrays[5].data();
  }
};

Gradients backward(const io::Scene& scene, const l4d_camera& camera, uint32_t path,
                   uint32_t threads = 2, double time = 1.1) {
  RendererHandle r = make_renderer(path, threads);
  r.set_gaussians(scene.view(), scene.timeline);
  r.set_time(time);
  Gradients out(scene);
  r.check(l4d_renderer_backward(r.get(), &camera, random_gradient(camera).data(), &out.g));
  return out;
}

void check_scene(const std::string& name, const io::Scene& scene, const l4d_camera& camera,
                 double largest, double relative, double time = 1.1) {
  const Gradients fast = backward(scene, camera, L4D_BACKEND_CPU, 2, time);
  const Gradients expected = backward(scene, camera, L4D_BACKEND_REFERENCE, 2, time);
  std::cout << name << ":";
  for (size_t k = 0; k < 6; ++k) {
    const Error error = error_of(fast.arrays[k], expected.arrays[k]);
    std::cout << " " << kAttributes[k] << " " << error.largest << " (" << error.relative << ")";
    EXPECT_LT(error.largest, largest) << name << ", " << kAttributes[k];
    EXPECT_LT(error.relative, relative) << name << ", " << kAttributes[k];
  }
  std::cout << "\n";
}

TEST(FastBackward, AllAttributes) {
  check_scene("synthetic", synth(6000), ring_camera(161, 97, 1), 5e-3, 2e-3);
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    check_scene("blobs of degree " + std::to_string(degree), blobs(300, -4, -1, 0.05, 0.05, degree),
                axis_camera(90, 57, 80), 5e-3, 2e-3);
  }
  check_scene("opaque blobs", blobs(300, -2, 0, 0.99, 0), axis_camera(64, 48, 50), 1e-2, 5e-3);
  io::Scene logits = blobs(300, -4, -1, 0.05, 0.05);
  io::opacity_to_logit(logits);
  io::positions_to_mean_time(logits);
  check_scene("logits, mean time", logits, axis_camera(90, 57, 80), 5e-3, 2e-3);
}

// Derivatives by scales and rotors of a needle are small differences of large numbers. What one of
// 100 pixels and more loses in binary32 must stay far below what it counts.
TEST(FastBackward, NeedlesOfTheScene) {
  for (const double ratio : {1e2, 1e4, 1e6}) {
    check_scene("short needles", needles(ratio, 0.2), axis_camera(200, 150, 180), 2e-2, 1e-2);
    check_scene("long needles", needles(ratio, 1), axis_camera(320, 200, 270), 2e-2, 1e-2);
  }
}

// Some of its Gaussians are a thousand pixels long here. Of these the derivatives by position and
// rotor are known to a few percent: the sums over their pixels are in binary32.
TEST(FastBackward, Basketball) {
#ifdef L4D_SANITIZED
  GTEST_SKIP() << "a real scene is drawn without sanitizers";
#endif
  const std::string path = test::data_file("basketball/basketball.ply");
  if (path.empty()) GTEST_SKIP() << "no basketball scene: set L4D_DATA_DIR";
  const io::CameraSet set = io::read_cameras(test::data_file("basketball/cameras.json"));
  check_scene("basketball", io::read_scene_ply(path), set.cameras.at(15).camera, 0.3, 0.15, 2.6);
}

TEST(FastBackward, AddsAndSkipsWhatIsNotWanted) {
  const io::Scene scene = blobs(200, -4, -1, 0.05, 0.05);
  const l4d_camera camera = axis_camera(60, 40, 50);
  const std::vector<float> gradient = random_gradient(camera);
  for (const uint32_t path : {L4D_BACKEND_CPU, L4D_BACKEND_REFERENCE}) {
    RendererHandle r = make_renderer(path);
    r.set_gaussians(scene.view(), scene.timeline);
    r.set_time(1.1);
    Gradients once(scene), onto(scene, 2.0f);
    r.check(l4d_renderer_backward(r.get(), &camera, gradient.data(), &once.g));
    r.check(l4d_renderer_backward(r.get(), &camera, gradient.data(), &onto.g));
    for (size_t k = 0; k < 6; ++k) {
      float largest = 0;
      for (size_t i = 0; i < once.arrays[k].size(); ++i) {
        EXPECT_EQ(onto.arrays[k][i], 2.0f + once.arrays[k][i]) << kAttributes[k];
        largest = std::max(largest, std::fabs(once.arrays[k][i]));
      }
      EXPECT_GT(largest, 0) << kAttributes[k];
    }
    // Each attribute alone is what it is among all.
    for (size_t wanted = 0; wanted < 6; ++wanted) {
      Gradients alone(scene);
      float** fields[] = {&alone.g.position, &alone.g.mean_t,  &alone.g.log_scale,
                          &alone.g.rotor,    &alone.g.opacity, &alone.g.sh};
      for (size_t k = 0; k < 6; ++k) {
        if (k != wanted) *fields[k] = nullptr;
      }
      r.check(l4d_renderer_backward(r.get(), &camera, gradient.data(), &alone.g));
      EXPECT_TRUE(equal_bits(alone.arrays[wanted], once.arrays[wanted])) << kAttributes[wanted];
    }
  }
}

TEST(FastBackward, ThreadsDoNotChangeBits) {
  const io::Scene scene = synth(12000, 6);
  const l4d_camera camera = ring_camera(161, 97, 1);
  const Gradients one = backward(scene, camera, L4D_BACKEND_CPU, 1);
  for (const uint32_t threads : {2u, 7u}) {
    const Gradients many = backward(scene, camera, L4D_BACKEND_CPU, threads);
    for (size_t k = 0; k < 6; ++k) EXPECT_TRUE(equal_bits(one.arrays[k], many.arrays[k]));
  }
}

}  // namespace
}  // namespace l4d::render
