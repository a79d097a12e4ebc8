// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "training/density/relocate_row.h"

// Splits in time: a row whose mean time some instants pull forward and others back stands for
// content that changes, which two halves of its life can follow.
namespace l4d::train {

constexpr uint32_t kSplitVisits = 100;     // steps that show a row before it is judged
constexpr float kSplitConsistency = 0.3f;  // |sum of derivatives| / sum of magnitudes is below it
constexpr double kSplitShare = 0.1;        // of the rows: those that are pulled most
constexpr double kHalfLife = 0.25;  // of the visible life: distance of the halves from its middle

// The mean magnitude of the derivative by the mean time; 0 for a row that fewer than `visits` steps
// have shown.
inline float time_pull(const DensityArrays& a, uint64_t i, uint32_t visits) {
  return a.time_visits[i] < visits || a.time_visits[i] == 0
             ? 0
             : a.time_magnitude[i] / static_cast<float>(a.time_visits[i]);
}

// The pull that kSplitShare of the rows exceed; 0 if steps have shown none of them often enough.
// Rows that are half way to being judged count, since those that were judged begin anew.
inline float split_threshold(const DensityArrays& a, uint64_t count) {
  std::vector<float> pulls;
  for (uint64_t i = 0; i < count; ++i) {
    const float pull = time_pull(a, i, kSplitVisits / 2);
    if (pull > 0 && std::isfinite(pull)) pulls.push_back(pull);
  }
  if (pulls.empty()) return 0;
  const auto place = static_cast<ptrdiff_t>(static_cast<double>(pulls.size() - 1) * kSplitShare);
  std::nth_element(pulls.begin(), pulls.begin() + place, pulls.end(), std::greater<float>());
  return pulls[static_cast<size_t>(place)];
}

// The part of the life of a row that lies within the sequence.
struct VisibleLife {
  double begin, end;  // s
  double sigma;       // of the whole life
};
inline VisibleLife visible_life(const DensityStep& s, double mean_t, float lambda) {
  const double sigma = 1 / std::sqrt(static_cast<double>(lambda));
  return {std::max(mean_t - 4 * sigma, s.time_begin), std::min(mean_t + 4 * sigma, s.time_end),
          sigma};
}
inline Slice4D<float> slice_of(const DensityArrays& a, uint64_t i) {
  float p[3][4];
  return slice_attributes<float>(a.value.rotor + 8 * i, a.value.log_scale + 4 * i, p);
}

// Whether the row is to be split.
inline bool is_torn(const DensityStep& s, const DensityArrays& a, uint64_t i) {
  if (!(s.split_above > 0 && time_pull(a, i, kSplitVisits) >= s.split_above)) return false;
  if (!(std::abs(a.time_gradient[i]) < kSplitConsistency * a.time_magnitude[i])) return false;
  const VisibleLife life =
      visible_life(s, static_cast<double>(a.value.mean_t[i]), slice_of(a, i).lambda);
  return life.end > life.begin;
}

// Moves the mean time of row i to `time`, along its way through space.
inline void move_in_time(const DensityStep& s, const DensityArrays& a, uint64_t i,
                         const float* velocity, double time) {
  const auto reference = [&] {
    return reference_time(static_cast<double>(a.value.mean_t[i]), s.time_begin, s.time_end);
  };
  const double before = reference();
  a.value.mean_t[i] = static_cast<float>(time);
  const float move = static_cast<float>(reference() - before);
  for (uint64_t c = 0; c < 3; ++c) a.value.position[3 * i + c] += velocity[c] * move;
}

// Row i becomes the earlier half of the life of `target`, which is torn, and `target` the later
// one. Halves of a life that the sequence cuts are shorter, so that together they look nearly as
// before; opacities stay.
inline void split_life(const DensityStep& s, const DensityArrays& a, uint64_t target, uint64_t i) {
  const Slice4D<float> slice = slice_of(a, target);
  const VisibleLife life =
      visible_life(s, static_cast<double>(a.value.mean_t[target]), slice.lambda);
  const double reach = kHalfLife * (life.end - life.begin), middle = (life.begin + life.end) / 2;
  if (reach < life.sigma) {
    a.value.log_scale[4 * target + 3] += static_cast<float>(std::log(reach / life.sigma));
  }
  copy_row(s, a, target, i);
  move_in_time(s, a, i, slice.velocity, middle - reach);
  move_in_time(s, a, target, slice.velocity, middle + reach);
  reset_row(s, a, target);
  reset_row(s, a, i);
}

}  // namespace l4d::train
