// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>

#include "l4d/render.h"
#include "libl4dcodec/scene/prepare.h"

namespace l4d::render {

// Where alpha blending ends, as 3D Gaussian splatting has it; it starts at kMinAlpha.
constexpr double kMaxAlpha = 0.999;  // never quite opaque, so that 1 - alpha has an inverse
constexpr double kMinTransmittance =
    1e-4;                          // a pixel is done before its transmittance would fall here
constexpr double kDilation = 0.3;  // pixels^2, added to both variances of every splat
// The affine approximation of the projection is taken at most this far outside the frame, in units
// of half its size: far outside it would blow splats up without bound.
constexpr double kFrustumMargin = 0.3;

// A camera, checked, with what all Gaussians need of it.
template <typename T>
struct View {
  int width = 0, height = 0;
  T fx{}, fy{}, cx{}, cy{};
  T rotation[9]{};     // [3, 3] world to camera
  T translation[3]{};  // world to camera
  T center[3]{};       // of the camera, in the world
  T near_plane{};
  // x/z and y/z at which the affine approximation is taken lie within these.
  T min_slope[2]{}, max_slope[2]{};
};

template <typename T>
View<T> make_view(const l4d_camera& camera) {
  View<T> v;
  v.width = static_cast<int>(camera.width);
  v.height = static_cast<int>(camera.height);
  v.fx = static_cast<T>(camera.fx);
  v.fy = static_cast<T>(camera.fy);
  v.cx = static_cast<T>(camera.cx);
  v.cy = static_cast<T>(camera.cy);
  v.near_plane = static_cast<T>(camera.near_plane);
  const double* m = camera.world_to_camera;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) v.rotation[3 * r + c] = static_cast<T>(m[4 * r + c]);
    v.translation[r] = static_cast<T>(m[4 * r + 3]);
    v.center[r] = static_cast<T>(-(m[r] * m[3] + m[4 + r] * m[7] + m[8 + r] * m[11]));
  }
  const double size[2] = {static_cast<double>(v.width), static_cast<double>(v.height)};
  const double focal[2] = {camera.fx, camera.fy};
  const double origin[2] = {camera.cx, camera.cy};
  for (int k = 0; k < 2; ++k) {
    const double margin = kFrustumMargin * 0.5 * size[k] / focal[k];
    v.min_slope[k] = static_cast<T>(-origin[k] / focal[k] - margin);
    v.max_slope[k] = static_cast<T>((size[k] - origin[k]) / focal[k] + margin);
  }
  return v;
}

}  // namespace l4d::render
