// SPDX-License-Identifier: Apache-2.0
// Where the cameras of a capture are.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "training/capture/capture.h"

namespace l4d::train {

void camera_center(const l4d_camera& camera, double* out) {
  const double* m = camera.world_to_camera;
  for (size_t c = 0; c < 3; ++c) {
    out[c] = -(m[c] * m[3] + m[4 + c] * m[7] + m[8 + c] * m[11]);
  }
}

CaptureFrame frame_of(const Capture& capture) {
  CaptureFrame frame{{0, 0, 0}, 0};
  double center[3];
  const double share = 1.0 / static_cast<double>(capture.cameras.size());
  for (const CaptureCamera& camera : capture.cameras) {
    camera_center(camera.source.camera, center);
    for (size_t k = 0; k < 3; ++k) frame.center[k] += share * center[k];
  }
  for (const CaptureCamera& camera : capture.cameras) {
    camera_center(camera.source.camera, center);
    double square = 0;
    for (size_t k = 0; k < 3; ++k) square += std::pow(center[k] - frame.center[k], 2);
    frame.radius = std::max(frame.radius, std::sqrt(square));
  }
  if (!(frame.radius > 1e-6)) frame.radius = 1;
  return frame;
}

void check_place(Capture* capture) {
  // Positions of Gaussians are float32, of which neighbours are so far apart at a coordinate of 1.
  constexpr double kStep = 1.0 / (1 << 23);
  // Of the radius: with fewer positions, images are visibly wrong, and with fewer yet, all of them.
  constexpr double kFine = 1e-3, kCoarse = 1e-2;
  const CaptureCamera* farthest = nullptr;
  double center[3], away = 0;
  for (const CaptureCamera& camera : capture->cameras) {
    camera_center(camera.source.camera, center);
    for (const double x : center) {
      if (std::abs(x) <= away) continue;
      away = std::abs(x);
      farthest = &camera;
    }
  }
  const double radius = frame_of(*capture).radius, step = kStep * away;
  if (farthest == nullptr || step <= kFine * radius) return;
  char text[400];
  std::snprintf(text, sizeof(text),
                "%s is %.3g units away from the origin of the coordinates, and the cameras are "
                "within %.3g of their middle. Positions have 32 bits, and are %.2g apart there; "
                "subtract an origin near the cameras from their poses, and from points",
                farthest->name.c_str(), away, radius, step);
  if (step > kCoarse * radius) {
    throw io::Error(L4D_ERR_FEATURE_UNSUPPORTED, capture->path + ": " + text);
  }
  capture->notes.push_back(std::string("Positions are coarse: ") + text + ".");
}

bool look_at_one_place(const Capture& capture) {
  // The point whose squared distances from all axes have the least sum: sum (I - d d') (x - c) = 0.
  double a[3][3] = {}, b[3] = {};
  std::vector<const double*> training;
  double center[3];
  for (const CaptureCamera& camera : capture.cameras) {
    if (camera.split != "train") continue;
    training.push_back(camera.source.camera.world_to_camera);
    const double* axis = training.back() + 8;
    camera_center(camera.source.camera, center);
    for (size_t r = 0; r < 3; ++r) {
      for (size_t c = 0; c < 3; ++c) {
        const double across = (r == c ? 1 : 0) - axis[r] * axis[c];
        a[r][c] += across;
        b[r] += across * center[c];
      }
    }
  }
  // By Cramer's rule. Where axes are parallel there is no such point.
  const auto determinant = [](const double m[3][3]) {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
           m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
  };
  const double whole = determinant(a), n = static_cast<double>(training.size());
  if (!(whole > 1e-9 * n * n * n)) return false;
  double x[3];
  for (size_t k = 0; k < 3; ++k) {
    double replaced[3][3];
    for (size_t r = 0; r < 3; ++r) {
      for (size_t c = 0; c < 3; ++c) replaced[r][c] = c == k ? b[r] : a[r][c];
    }
    x[k] = determinant(replaced) / whole;
  }
  const double wanted = 0.5 * frame_of(capture).radius;
  const auto near = std::count_if(training.begin(), training.end(), [&](const double* m) {
    return !(m[8] * x[0] + m[9] * x[1] + m[10] * x[2] + m[11] >= wanted);
  });
  return 20 * static_cast<size_t>(near) <= training.size();
}

}  // namespace l4d::train
