// SPDX-License-Identifier: Apache-2.0
// The worst Gaussian of a decoded scene: what a mean over images hides.
#pragma once

#include "bench/accuracy/coding.h"

namespace l4d::bench {

// Largest errors over all coded Gaussians, in the units in which presets declare their bounds
// (docs/numerics.md, "Bounds on single Gaussians"), worked out from the decoded arrays alone
// (eval/).
struct WorstGaussian {
  // Distance between where it is and where it ought to be while it has half of the greatest opacity
  // that it reaches, over its largest standard deviation, or 1/4000 of the scene if that is larger.
  double position = 0;
  double mean_time = 0;  // over its own temporal standard deviation
  // Factor between principal variances, each with 1/4000 squared added, or 1 and the largest change
  // of a variance in any direction in parts of the largest.
  double covariance = 1;
  double opacity = 0;  // difference of what is seen at an instant
};

WorstGaussian worst_gaussian(const io::Scene& original, const Encoded& encoded);

}  // namespace l4d::bench
