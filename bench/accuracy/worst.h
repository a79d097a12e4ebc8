// SPDX-License-Identifier: Apache-2.0
// The worst Gaussian of a decoded scene: what a mean over images hides.
#pragma once

#include "bench/accuracy/coding.h"

namespace l4d::bench {

// Largest errors over all coded Gaussians, while a Gaussian has at least half of its opacity.
struct WorstGaussian {
  // Distance between where it is and where it ought to be, over the larger of its own largest
  // standard deviation and 1/4000 of the scene's extent.
  double position = 0;
  double mean_time = 0;   // over its own temporal standard deviation
  double covariance = 1;  // factor by which its largest variance is off, at least 1
  double opacity = 0;
};

WorstGaussian worst_gaussian(const io::Scene& original, const Encoded& encoded);

}  // namespace l4d::bench
