// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>

#include "l4d/l4d.h"
#include "libl4dcodec/math/hd.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {

// Scenes keep to this; what was coded near it may come back a little beyond, and is a scene still.
constexpr float kMaxLogScale = 16;
constexpr float kLogScaleMargin = 1;
constexpr double kMaxCoordinate = 0x1p60;

// What decoded attributes are clamped to (spec: section 14, "Ranges"), so that no covariance and no
// velocity of a stream overflows binary32.
constexpr float kMaxDecodedLogScale = kMaxLogScale + kLogScaleMargin;
L4D_HOST_DEVICE inline float clamp_log_scale(float v) {
  return v < -kMaxDecodedLogScale  ? -kMaxDecodedLogScale
         : v > kMaxDecodedLogScale ? kMaxDecodedLogScale
                                   : v;
}
L4D_HOST_DEVICE inline float clamp_opacity(float v) {
  return v < 0.0f ? 0.0f : v > 1.0f ? 1.0f : v;
}

// Name of the first attribute of Gaussian i that is no value a scene may hold, or null.
inline const char* invalid_attribute(const l4d_gaussians& g, size_t i) {
  for (size_t k = 0; k < 3; ++k) {
    if (!(std::fabs(g.position[3 * i + k]) <= kMaxCoordinate)) return "position";
  }
  if (!(std::fabs(mean_time(g, i)) <= kMaxCoordinate)) return "mean_t";
  for (size_t k = 0; k < 4; ++k) {
    if (!(std::fabs(g.log_scale[4 * i + k]) <= kMaxDecodedLogScale)) return "log_scale";
  }
  for (size_t k = 0; k < 8; ++k) {
    if (!(std::fabs(g.rotor[8 * i + k]) <= 1e15f)) return "rotor";
  }
  const bool logit = (g.flags & L4D_OPACITY_LOGIT) != 0;
  if (!(logit ? std::isfinite(g.opacity[i]) : g.opacity[i] >= 0 && g.opacity[i] <= 1)) {
    return "opacity";
  }
  const size_t sh_dim = size_t{3} * (g.sh_degree + 1) * (g.sh_degree + 1);
  for (size_t k = 0; k < sh_dim; ++k) {
    // The codebooks hold binary16.
    if (!(std::fabs(g.sh[sh_dim * i + k]) <= 65504.0f)) return "sh";
  }
  return nullptr;
}

}  // namespace l4d
