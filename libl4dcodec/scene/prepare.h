// SPDX-License-Identifier: Apache-2.0
// What of a 4D Gaussian does not change from instant to instant, one at a time, on any side.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "l4d/l4d.h"
#include "libl4dcodec/math/hd.h"
#include "libl4dcodec/scene/attributes.h"
#include "libl4dcodec/scene/slice.h"
#include "libl4dcodec/scene/timeline.h"
#include "libl4dcodec/scene/window.h"

namespace l4d {

constexpr double kMinAlpha = 1.0 / 255.0;  // renderers skip what is fainter, as 3DGS does

struct Prepared {
  Slice4D<double> slice;
  double position[3];  // at reference
  double reference;    // seconds
  double mean;         // seconds
  double opacity;
  double half_life;    // alpha may reach kMinAlpha within this of the mean time; negative: never
  FrameWindow window;  // flat ones do not fade, and their slice.lambda is 0
};

// A Gaussian is visible with an opacity of at least `least` while lambda dt^2 is at most this;
// negative: never.
template <typename T>
L4D_HOST_DEVICE inline T reach_of(T opacity, T least, T gate) {
  const T fade = 2 * std::log(opacity / least);
  return fade < gate ? fade : gate;
}

// For how long before and after its mean time that is; negative: never.
template <typename T>
L4D_HOST_DEVICE inline T half_life(T reach, T lambda) {
  return reach < 0 ? static_cast<T>(-1) : std::sqrt(reach / lambda);
}

// Gaussian i of arrays that the caller's side can read.
L4D_HOST_DEVICE inline Prepared prepare_gaussian(const l4d_gaussians& g, const Sequence& sequence,
                                                 size_t i) {
  Prepared p;
  p.slice = slice_attributes<double>(g.rotor + 8 * i, g.log_scale + 4 * i);
  p.mean = mean_time(g, i);
  // Seen from within the sequence, whatever the form of the input: with the mean 200 s away, a
  // position there and a velocity in binary32 would not say where the Gaussian is now.
  p.reference = reference_time(p.mean, sequence.begin, sequence.end);
  const bool at_mean = (g.flags & L4D_POSITION_AT_MEAN_TIME) != 0;
  for (size_t k = 0; k < 3; ++k) {
    p.position[k] = static_cast<double>(g.position[3 * i + k]);
    if (at_mean) p.position[k] += p.slice.velocity[k] * (p.reference - p.mean);
  }
  p.opacity = linear_opacity(static_cast<double>(g.opacity[i]), (g.flags & L4D_OPACITY_LOGIT) != 0);
  const double reach = reach_of(p.opacity, kMinAlpha, static_cast<double>(kVisibilityGate));
  p.window = window_of(g, i);
  if (p.window.is_flat()) p.slice.lambda = 0;
  p.half_life = p.window.is_flat() && reach >= 0 ? static_cast<double>(INFINITY)
                                                 : half_life(reach, p.slice.lambda);
  return p;
}

// When a Gaussian is shown, in seconds from some moment; begin > end: never.
struct alignas(8) VisibleInterval {
  float begin, end;
  L4D_HOST_DEVICE bool holds(float t) const { return t >= begin && t <= end; }
};
template <typename T>
L4D_HOST_DEVICE inline VisibleInterval interval_of(T mean, T half_life) {
  if (!(half_life >= 0)) return {1.0f, 0.0f};
  return {static_cast<float>(mean - half_life), static_cast<float>(mean + half_life)};
}

enum MotionGroup : uint8_t { kStill, kFading, kMoving };
constexpr uint32_t kNumMotionGroups = 3;

// What of a Gaussian can be seen to change while the sequence lasts. Rounding decides: what
// binary32 cannot show is not worked out.
template <typename T>
L4D_HOST_DEVICE inline MotionGroup group_of(const T* velocity /* [3] */, T lambda, T mean,
                                            T half_life, T begin, T end) {
  if (velocity[0] != 0 || velocity[1] != 0 || velocity[2] != 0) return kMoving;
  const T before = std::fabs(begin - mean), after = std::fabs(end - mean);
  const T farthest = before < after ? after : before;
  const bool fades = static_cast<T>(0.5) * lambda * farthest * farthest >= static_cast<T>(0x1p-25);
  return fades || half_life < farthest ? kFading : kStill;
}

L4D_HOST_DEVICE inline MotionGroup group_of(const Prepared& p, const Sequence& sequence) {
  const MotionGroup group =
      group_of(p.slice.velocity, p.slice.lambda, p.mean, p.half_life, sequence.begin, sequence.end);
  return group == kStill && p.window.is_flat() ? kFading : group;
}

}  // namespace l4d
