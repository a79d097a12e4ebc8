// SPDX-License-Identifier: Apache-2.0
// Scenes, cameras and images that the tests of the renderer share.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "io/synth/synth.h"
#include "l4d/render.hpp"
#include "tests/common/random.h"

namespace l4d::render {

// Looks from `eye` at `target`; the principal point is the centre of the image.
inline l4d_camera call_on(uint32_t width, uint32_t height, double focal,
                          const double* eye /* [3] */, const double* target /* [3] */) {
  l4d_camera camera = L4D_INIT(l4d_camera);
  camera.width = width;
  camera.height = height;
  camera.fx = focal;
  camera.fy = focal;
  camera.cx = 0.5 * width;
  camera.cy = 0.5 * height;
  camera.near_plane = 0.02;
  const auto normalize = [](double* v) {
    const double norm = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int k = 0; k < 3; ++k) v[k] /= norm;
  };
  const auto cross = [](const double* a, const double* b, double* out) {
    for (int k = 0; k < 3; ++k) {
      out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
    }
  };
  double axes[3][3];  // right, down, forward
  for (int k = 0; k < 3; ++k) axes[2][k] = target[k] - eye[k];
  normalize(axes[2]);
  const double down[3] = {0.02, 1, 0.01};
  cross(down, axes[2], axes[0]);
  normalize(axes[0]);
  cross(axes[2], axes[0], axes[1]);
  for (int r = 0; r < 3; ++r) {
    double translation = 0;
    for (int c = 0; c < 3; ++c) {
      camera.world_to_camera[4 * r + c] = axes[r][c];
      translation -= axes[r][c] * eye[c];
    }
    camera.world_to_camera[4 * r + 3] = translation;
  }
  return camera;
}

// On a ring around the origin.
inline l4d_camera ring_camera(uint32_t width, uint32_t height, double angle, double distance = 6) {
  const double eye[3] = {distance * std::cos(angle), -1.5, distance * std::sin(angle)};
  const double target[3] = {0, -0.5, 0};
  return call_on(width, height, 0.9 * std::max(width, height), eye, target);
}

// At the origin, looking along z.
inline l4d_camera axis_camera(uint32_t width, uint32_t height, double focal) {
  const double eye[3] = {0, 0, 0}, target[3] = {0, 0, 1};
  l4d_camera camera = call_on(width, height, focal, eye, target);
  std::fill_n(camera.world_to_camera, 12, 0.0);
  for (int k = 0; k < 3; ++k) camera.world_to_camera[5 * k] = 1;
  return camera;
}

// The scene with SH of lower degree.
inline io::Scene with_degree(const io::Scene& scene, uint32_t degree) {
  io::Scene out = scene;
  out.sh_degree = degree;
  const size_t from = 3 * scene.sh_coefficients(), to = 3 * out.sh_coefficients();
  out.sh.resize(scene.count() * to);
  for (size_t i = 0; i < scene.count(); ++i) {
    std::copy_n(scene.sh.begin() + static_cast<std::ptrdiff_t>(from * i), to,
                out.sh.begin() + static_cast<std::ptrdiff_t>(to * i));
  }
  return out;
}

inline io::Scene synth(uint64_t gaussians, uint64_t seed = 1) {
  io::SynthOptions options;
  options.gaussians = gaussians;
  options.seconds = 4;
  options.seed = seed;
  return io::synthesize(options);
}

// Made Gaussian by Gaussian.
class SceneBuilder {
 public:
  explicit SceneBuilder(uint32_t degree = 0) {
    scene_.sh_degree = degree;
    scene_.timeline.num_frames = 60;
    scene_.timeline.fps_num = 30;
    scene_.timeline.fps_den = 1;
  }
  // There all the time, without motion. log_scale [3].
  size_t add(double x, double y, double z, const double* log_scale, double opacity,
             const double* rgb) {
    const size_t i = scene_.count();
    scene_.resize(i + 1);
    const double position[3] = {x, y, z};
    for (size_t k = 0; k < 3; ++k) {
      scene_.position[3 * i + k] = static_cast<float>(position[k]);
      scene_.log_scale[4 * i + k] = static_cast<float>(log_scale[k]);
      scene_.sh[3 * scene_.sh_coefficients() * i + k] =
          static_cast<float>((rgb[k] - 0.5) / 0.28209479177387814);
    }
    scene_.log_scale[4 * i + 3] = 12;
    scene_.rotor[8 * i] = 1;
    scene_.mean_t[i] = 1;
    scene_.opacity[i] = static_cast<float>(opacity);
    return i;
  }
  size_t add_ball(double x, double y, double z, double sigma, double opacity, const double* rgb) {
    const double log_scale[3] = {std::log(sigma), std::log(sigma), std::log(sigma)};
    return add(x, y, z, log_scale, opacity, rgb);
  }
  // A random direction for the axes of Gaussian i, and, with speed, motion.
  void turn(size_t i, test::Random& random, double speed = 0) {
    for (size_t k = 0; k < 4; ++k) {
      scene_.rotor[8 * i + k] = static_cast<float>(random.normal());
      scene_.rotor[8 * i + 4 + k] = static_cast<float>(speed * random.normal());
    }
  }
  io::Scene& scene() { return scene_; }

 private:
  io::Scene scene_;
};

inline RendererHandle make_renderer(uint32_t path, uint32_t threads = 2,
                                    uint32_t exponential = L4D_RENDER_EXP_ACCURATE) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.backend = path;
  options.threads = threads;
  options.exponential = exponential;
  return RendererHandle(&options);
}

struct TestImage {
  std::vector<float> rgb, alpha;
  l4d_render_stats stats;
};

inline TestImage render_both(const RendererHandle& renderer, const l4d_camera& camera) {
  TestImage out;
  const size_t pixels = size_t{camera.width} * camera.height;
  // Anything the renderer leaves as it is shows.
  out.rgb.assign(3 * pixels, -7.0f);
  out.alpha.assign(pixels, -7.0f);
  l4d_image image = L4D_INIT(l4d_image);
  image.rgb = out.rgb.data();
  image.alpha = out.alpha.data();
  renderer.check(l4d_renderer_render(renderer.get(), &camera, &image));
  out.stats = renderer.stats();
  return out;
}

inline double largest_difference(const std::vector<float>& a, const std::vector<float>& b) {
  EXPECT_EQ(a.size(), b.size());
  double most = 0;
  for (size_t k = 0; k < std::min(a.size(), b.size()); ++k) {
    const double d = std::fabs(static_cast<double>(a[k]) - static_cast<double>(b[k]));
    most = d <= most ? most : d;  // NaN counts
  }
  return most;
}

inline bool equal_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0);
}

}  // namespace l4d::render
