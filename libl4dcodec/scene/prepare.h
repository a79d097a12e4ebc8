// SPDX-License-Identifier: Apache-2.0
// What of a 4D Gaussian does not change from instant to instant, one at a time, on any side.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "l4d/l4d.h"
#include "libl4dcodec/math/hd.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d {

constexpr double kMinAlpha = 1.0 / 255.0;  // renderers skip what is fainter, as 3DGS does

struct Prepared {
  Slice4D<double> slice;
  double position[3];  // at reference
  double reference;    // seconds
  double mean;         // seconds
  double opacity;
  double half_life;  // alpha may reach kMinAlpha within this of the mean time; negative: never
};

// Gaussian i of arrays that the caller's side can read. The sequence lasts from begin to end.
L4D_HOST_DEVICE inline Prepared prepare_gaussian(const l4d_gaussians& g, double begin, double end,
                                                 size_t i) {
  double rotor[8], scale[4];
  for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(g.rotor[8 * i + k]);
  for (size_t k = 0; k < 4; ++k) scale[k] = std::exp(static_cast<double>(g.log_scale[4 * i + k]));
  Prepared p;
  p.slice = slice_gaussian(normalized_halves(rotor), scale);
  p.mean = mean_time(g, i);
  // Seen from within the sequence, whatever the form of the input: with the mean 200 s away, a
  // position there and a velocity in binary32 would not say where the Gaussian is now.
  p.reference = p.mean < begin ? begin : p.mean > end ? end : p.mean;
  const bool at_mean = (g.flags & L4D_POSITION_AT_MEAN_TIME) != 0;
  for (size_t k = 0; k < 3; ++k) {
    p.position[k] = static_cast<double>(g.position[3 * i + k]);
    if (at_mean) p.position[k] += p.slice.velocity[k] * (p.reference - p.mean);
  }
  p.opacity = static_cast<double>(g.opacity[i]);
  if ((g.flags & L4D_OPACITY_LOGIT) != 0) p.opacity = 1 / (1 + std::exp(-p.opacity));
  const double fade = 2 * std::log(p.opacity / kMinAlpha);
  const double gate = static_cast<double>(kVisibilityGate);
  p.half_life = fade < 0 ? -1 : std::sqrt((fade < gate ? fade : gate) / p.slice.lambda);
  return p;
}

enum MotionGroup : uint8_t { kStill, kFading, kMoving };
constexpr uint32_t kNumMotionGroups = 3;

// What of a Gaussian can be seen to change while the sequence lasts. Rounding decides: what
// binary32 cannot show is not worked out.
L4D_HOST_DEVICE inline MotionGroup group_of(const Prepared& p, double begin, double end) {
  const double* v = p.slice.velocity;
  if (v[0] != 0 || v[1] != 0 || v[2] != 0) return kMoving;
  const double before = std::fabs(begin - p.mean), after = std::fabs(end - p.mean);
  const double farthest = before < after ? after : before;
  const bool fades = 0.5 * p.slice.lambda * farthest * farthest >= 0x1p-25;
  return fades || p.half_life < farthest ? kFading : kStill;
}

}  // namespace l4d
