// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

#include "l4d/render.h"
#include "libl4dcodec/scene/prepare.h"
#include "libl4dcodec/scene/rendering.h"

namespace l4d::render {

// Where alpha blending ends unless the scene says otherwise; it starts at kMinAlpha.
constexpr double kMaxAlpha = 0.999;  // never quite opaque, so that 1 - alpha has an inverse
constexpr double kMinTransmittance =
    1e-4;                          // a pixel is done before its transmittance would fall here
constexpr double kDilation = 0.3;  // pixels^2, added to both variances of every splat, likewise
// The affine approximation of the projection is taken at most this far outside the frame, in units
// of half its size: far outside it would blow splats up without bound.
constexpr double kFrustumMargin = 0.3;

// What a scene asks of renderers (l4d_rendering). The defaults are those of 3D Gaussian splatting.
template <typename T>
struct SplatRules {
  T dilation = static_cast<T>(kDilation);  // pixels^2
  T min_alpha = static_cast<T>(kMinAlpha);
  T max_alpha = static_cast<T>(kMaxAlpha);
  // Square of the Mahalanobis distance at which a splat ends, whatever its alpha is there.
  T max_reach = std::numeric_limits<T>::max();
  bool compensates = false;  // opacity makes up for what dilation adds
};

template <typename T>
SplatRules<T> make_rules(const l4d_rendering& r) {
  SplatRules<T> rules;
  // The defaults are decimal numbers, which a double holds better than the float that says them.
  const l4d_rendering usual = default_rendering();
  if (r.dilation != usual.dilation) rules.dilation = static_cast<T>(r.dilation);
  if (r.min_alpha != usual.min_alpha) rules.min_alpha = static_cast<T>(r.min_alpha);
  if (r.max_alpha != usual.max_alpha) rules.max_alpha = static_cast<T>(r.max_alpha);
  if (r.cutoff > 0) rules.max_reach = static_cast<T>(r.cutoff) * static_cast<T>(r.cutoff);
  rules.compensates = r.compensation != 0;
  return rules;
}

// A view of a trainer, checked.
struct TrainableView {
  l4d_camera camera;
  double time;
  float background[3];
  float* rgb;
  float* alpha;
};

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
  SplatRules<T> rules;
};

template <typename T>
View<T> make_view(const l4d_camera& camera, const l4d_rendering& rendering = default_rendering()) {
  View<T> v;
  v.rules = make_rules<T>(rendering);
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
