// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "libl4dcodec/scene/timeline.h"

namespace l4d {

// What a session knows of a Gaussian besides its attributes.
struct PooledGaussian {
  static constexpr uint32_t kNoStanding = UINT32_MAX;

  Sequence shown;  // when its opacity is above what is seen, in seconds; empty: never
  double velocity[3];
  double lambda;      // 0: it has a flat window, which is `shown`
  double mean;        // seconds
  double reference;   // the time that its position is of, in seconds
  double exposure;    // part of the piece that it came with during which it was shown
  double share;       // see EncoderInput
  uint32_t standing;  // the standing member that it is in

  double shown_between(double begin, double end) const;  // seconds, weighted by its falloff
};

inline double PooledGaussian::shown_between(double begin, double end) const {
  const double a = std::max(begin, shown.begin), b = std::min(end, shown.end);
  if (!(a < b)) return 0;
  if (lambda == 0) return b - a;
  const double slope = std::sqrt(lambda / 2);
  const double integral = std::erf(slope * (b - mean)) - std::erf(slope * (a - mean));
  return std::min(b - a, std::sqrt(std::acos(-1.0)) / (2 * slope) * integral);
}

}  // namespace l4d
