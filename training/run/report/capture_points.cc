// SPDX-License-Identifier: Apache-2.0
#include "training/run/report/capture_points.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include "eval/views/views.h"
#include "io/file/file.h"
#include "l4d/experimental/sensitivity.hpp"
#include "libl4dcodec/scene/sh.h"
#include "training/model/random.h"

namespace l4d::train {
namespace {

constexpr double kError = 1;  // pixels

// Of each Gaussian how many pixels it fills, all images together.
std::vector<float> pixels_filled(const io::Scene& scene, const io::CameraSet& set, double time,
                                 uint32_t threads) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.threads = threads;
  RendererHandle renderer(&options);
  renderer.set_gaussians(scene.view(), scene.timeline);
  renderer.set_time(time);
  SensitivityHandle sensitivity(nullptr, scene.count(), scene.sh_degree);
  for (const io::Camera& camera : set.cameras) {
    if (camera.split == "test") continue;
    sensitivity.add_view(renderer, camera.camera);
  }
  return sensitivity.weights(L4D_WEIGHT_ALPHA_T);
}

// Scene units that a pixel of the nearest training camera spans there.
double pixel_at(const io::CameraSet& set, const float* position) {
  double least = std::numeric_limits<double>::max();
  for (const io::Camera& camera : set.cameras) {
    const double* row = camera.camera.world_to_camera + 8;
    double depth = row[3];
    for (size_t k = 0; k < 3; ++k) depth += row[k] * static_cast<double>(position[k]);
    if (camera.split != "test" && depth > 0) least = std::min(least, depth / camera.camera.fx);
  }
  return least;
}

struct Drawn {
  double key;  // the largest are taken
  uint32_t row;
};

}  // namespace

void write_capture_points(const std::string& path, const io::Scene& scene, const io::CameraSet& set,
                          uint32_t count, double begin, double middle, uint32_t threads) {
  const io::Scene instant = eval::instant_of(scene, begin + middle);
  const std::vector<float> pixels = pixels_filled(scene, set, begin + middle, threads);
  std::vector<Drawn> drawn;
  for (uint32_t i = 0; i < instant.count(); ++i) {
    if (!(pixels[i] > 0)) continue;
    const double u = static_cast<double>(uniform(philox(0, 0, i, Use::kStart).v[0]));
    drawn.push_back({std::log(u) / static_cast<double>(pixels[i]), i});
  }
  const size_t n = std::min<size_t>(count, drawn.size());
  std::partial_sort(drawn.begin(), drawn.begin() + static_cast<ptrdiff_t>(n), drawn.end(),
                    [](const Drawn& a, const Drawn& b) { return a.key > b.key; });
  std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(n) +
                     "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
                     "property uchar green\nproperty uchar blue\nproperty float t\nend_header\n";
  const size_t width = 3 * scene.sh_coefficients();
  for (size_t k = 0; k < n; ++k) {
    const size_t i = drawn[k].row;
    float noise[4];
    normal4(philox(0, 1, i, Use::kStart), noise);
    double p[3];
    const double off = kError * pixel_at(set, &instant.position[3 * i]);
    int rgb[3];
    for (size_t c = 0; c < 3; ++c) {
      p[c] = static_cast<double>(instant.position[3 * i + c]) + off * static_cast<double>(noise[c]);
      const double shown =
          0.5 + static_cast<double>(sh_constant::k0) * static_cast<double>(scene.sh[width * i + c]);
      rgb[c] = static_cast<int>(std::lround(255 * std::clamp(shown, 0.0, 1.0)));
    }
    char line[160];
    std::snprintf(line, sizeof(line), "%.6g %.6g %.6g %d %d %d %.6g\n", p[0], p[1], p[2], rgb[0],
                  rgb[1], rgb[2], middle);
    text += line;
  }
  io::OutputFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

}  // namespace l4d::train
