// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "eval/jod/sensitivity.h"

namespace l4d::eval {

// What is left of a frame: for each channel one number a band, the base band last; no bands where a
// channel is not there.
using JodFrame = std::array<std::vector<double>, kJodChannels>;

// (x + e)^p - e^p, which weak differences depend on; 0 for 0. x: 0 or more.
double safe_power(double x, double p);

// Just-objectionable differences: 10 for no difference, one less where 75 % of people prefer the
// other video. frames: all of a video, or one image.
double pooled_jod(const std::vector<JodFrame>& frames);

}  // namespace l4d::eval
