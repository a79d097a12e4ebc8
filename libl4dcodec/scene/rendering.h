// SPDX-License-Identifier: Apache-2.0
// How a scene asks to be drawn and shown: defaults and ranges (spec: sections "Rendering" and
// "Presentation").
#pragma once

#include <cmath>

#include "l4d/l4d.h"

namespace l4d {

// Those of 3D Gaussian splatting.
inline l4d_rendering default_rendering() {
  l4d_rendering r{};
  r.struct_size = sizeof(r);
  r.dilation = 0.3f;
  r.min_alpha = 1.0f / 255.0f;
  r.max_alpha = 0.999f;
  return r;
}

// Five zeros are the numbers of 3D Gaussian splatting.
inline l4d_rendering resolved(const l4d_rendering& r) {
  const bool unset = r.dilation == 0 && r.cutoff == 0 && r.min_alpha == 0 && r.max_alpha == 0 &&
                     r.compensation == 0;
  return unset ? default_rendering() : r;
}

inline bool is_default(const l4d_rendering& r) {
  const l4d_rendering usual = default_rendering();
  return r.dilation == usual.dilation && r.cutoff == usual.cutoff &&
         r.min_alpha == usual.min_alpha && r.max_alpha == usual.max_alpha &&
         r.compensation == usual.compensation;
}

// Below 1/255 slices leave Gaussians out, and above 0.999 what lies behind one has no derivative.
inline bool is_valid(const l4d_rendering& r) {
  const auto within = [](float v, float least, float most) { return v >= least && v <= most; };
  return within(r.dilation, 0, 16) && (r.cutoff == 0 || within(r.cutoff, 1, 16)) &&
         within(r.min_alpha, 1.0f / 255.0f, 0.25f) && within(r.max_alpha, 0.5f, 0.999f) &&
         r.compensation <= 1;
}

inline l4d_presentation default_presentation() {
  l4d_presentation p{};
  p.struct_size = sizeof(p);
  return p;
}

inline bool is_default(const l4d_presentation& p) {
  return p.playback == L4D_PLAYBACK_UNSTATED && p.has_bounds == 0 && p.has_camera == 0 &&
         p.metres_per_unit == 0;
}

// Playback modes are a registry: a number that this library does not know is valid.
inline bool is_valid(const l4d_presentation& p) {
  if (p.playback > 255 || p.has_bounds > 1 || p.has_camera > 1) return false;
  if (!(p.metres_per_unit >= 0) || std::isinf(p.metres_per_unit)) return false;
  for (int k = 0; k < 3 && p.has_bounds != 0; ++k) {
    if (!std::isfinite(p.bounds_min[k]) || !std::isfinite(p.bounds_max[k]) ||
        !(p.bounds_min[k] <= p.bounds_max[k])) {
      return false;
    }
  }
  if (p.has_camera == 0) return true;
  double forward[3];
  for (int k = 0; k < 3; ++k) {
    if (!std::isfinite(p.camera_position[k]) || !std::isfinite(p.camera_target[k]) ||
        !std::isfinite(p.camera_up[k])) {
      return false;
    }
    forward[k] = p.camera_target[k] - p.camera_position[k];
  }
  const double* up = p.camera_up;
  const double cross[3] = {forward[1] * up[2] - forward[2] * up[1],
                           forward[2] * up[0] - forward[0] * up[2],
                           forward[0] * up[1] - forward[1] * up[0]};
  const double area = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2];
  return area > 0 && !std::isinf(area) && p.camera_fov > 0 && p.camera_fov < 3.0;
}

}  // namespace l4d
