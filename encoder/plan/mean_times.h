// SPDX-License-Identifier: Apache-2.0
// Mean times as codes: none is off by more than its Gaussian allows (docs/decisions/0010).
#pragma once

#include <cstdint>
#include <vector>

#include "libl4dcodec/container/scene_header.h"

namespace l4d {

// A mean time in seconds from the centre of its bucket, and how far off it may be.
struct MeanTimeTarget {
  double local;
  double tolerance;
};

// What a page holds of it, and what a decoder makes of that.
struct MeanTimeCode {
  uint16_t code = 0;  // binary16, or of fixed ones
  uint16_t fine = 0;
  float local = 0;
  bool within = false;  // the tolerance
};

// Whether every mean time inside a bucket of this width can be coded to `tolerance`: codes have
// their steps, and so has binary32, which a decoder gives local times in.
bool mean_time_fits(bool f16, double width, double tolerance);

// Whether codes of fixed mean times that reach `reach` seconds from the bucket's centre are fine
// enough for the tolerance.
bool fixed_mean_times_fit(double reach, double tolerance);

// Chooses how the mean times of a layer are coded: f16 and its shift, or fixed where `f16` is
// false. width: of a bucket. shift: of f16, -1 = as the tolerances allow.
void choose_mean_times(const std::vector<MeanTimeTarget>& targets, bool f16, int shift,
                       double width, MeanTimeCoding* coding);

// The shortest code that is within the tolerance; where there is none, the nearest.
MeanTimeCode code_mean_time(const MeanTimeCoding& coding, double width,
                            const MeanTimeTarget& target);

}  // namespace l4d
