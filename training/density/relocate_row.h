// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>

#include "libl4dcodec/scene/slice.h"
#include "libl4dcodec/scene/timeline.h"
#include "training/density/relocate.h"
#include "training/model/random.h"

// Relocation of one row, on the host and on devices.
namespace l4d::train {

constexpr int kMaxCopies = 32;
constexpr float kChildDistance = 0.6f;  // standard deviations

// The opacity that n copies in one place have, so that together they have `opacity`.
L4D_HOST_DEVICE inline double split_opacity(double opacity, int n) {
  return 1 - std::pow(1 - opacity, 1.0 / n);
}

// The factor of the spatial scales of n copies: the integral of their blended alpha along a line
// equals that of the one Gaussian.
L4D_HOST_DEVICE inline double split_scale(double opacity, double split, int n) {
  double sum = 0;
  for (int i = 1; i <= n; ++i) {
    double binomial = 1, power = split;
    for (int k = 0; k < i; ++k) {
      sum += (k % 2 == 0 ? binomial : -binomial) * power / std::sqrt(static_cast<double>(k + 1));
      binomial = binomial * (i - 1 - k) / (k + 1);
      power *= split;
    }
  }
  return opacity / sum;
}

L4D_HOST_DEVICE inline bool is_dead(const DensityStep& s, const DensityArrays& a, uint64_t i) {
  const float logit = a.value.opacity[i];
  float sum = logit + a.value.mean_t[i];
  for (uint64_t k = 3 * i; k < 3 * i + 3; ++k) sum += a.value.position[k];
  for (uint64_t k = 4 * i; k < 4 * i + 4; ++k) sum += a.value.log_scale[k];
  for (uint64_t k = 8 * i; k < 8 * i + 8; ++k) sum += a.value.rotor[k];
  if (!(sum * 0 == 0)) return true;
  if (!(linear_opacity(logit, true) >= kDeadOpacity)) return true;
  return s.unseen_since != 0 && a.last_shown[i] < s.unseen_since && a.born[i] < s.unseen_since;
}

// The row whose share of the weights contains u in (0, 1).
L4D_HOST_DEVICE inline uint64_t draw_target(const double* cumulative, uint64_t count, double u) {
  const double wanted = u * cumulative[count - 1];
  uint64_t low = 0, high = count - 1;
  while (low < high) {
    const uint64_t middle = (low + high) / 2;
    if (cumulative[middle] > wanted) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  return low;
}

// The target of the row with this id, or kNoTarget if both of the rows that are drawn have died
// since the weights were made. A uniform number has 48 bits, of two of 24.
constexpr uint64_t kNoTarget = ~uint64_t{0};
L4D_HOST_DEVICE inline uint64_t target_of(const DensityStep& s, const DensityArrays& a,
                                          uint32_t id) {
  const Random4 r = philox(s.seed, s.step, id, Use::kTarget);
  for (int k = 0; k < 4; k += 2) {
    const double u =
        (static_cast<double>(r.v[k] >> 8) + static_cast<double>(uniform(r.v[k + 1]))) * 0x1p-24;
    const uint64_t target = draw_target(a.cumulative, a.sampled, u);
    if (!is_dead(s, a, target)) return target;
  }
  return kNoTarget;
}

L4D_HOST_DEVICE inline void reset_row(const DensityStep& s, const DensityArrays& a, uint64_t i) {
  // Widths as numbers: device code cannot read the table of attributes.
  const auto clear = [&](float* m, float* v, uint64_t width) {
    for (uint64_t k = width * i; k < width * (i + 1); ++k) m[k] = v[k] = 0;
  };
  clear(a.m.position, a.v.position, 3);
  clear(a.m.mean_t, a.v.mean_t, 1);
  clear(a.m.log_scale, a.v.log_scale, 4);
  clear(a.m.rotor, a.v.rotor, 8);
  clear(a.m.opacity, a.v.opacity, 1);
  clear(a.m.sh, a.v.sh, 3 * (s.sh_degree + 1) * (s.sh_degree + 1));
  a.updates[i] = 0;
  if (a.time_visits != nullptr) {
    a.time_gradient[i] = a.time_magnitude[i] = 0;
    a.time_visits[i] = 0;
  }
  a.prepared[i] = a.born[i] = a.last_shown[i] = static_cast<uint32_t>(s.step);
}

// Gives `target`, which n - 1 children will copy, its share of opacity and size.
L4D_HOST_DEVICE inline void shrink_target(const DensityStep& s, const DensityArrays& a,
                                          uint64_t target, int n) {
  double opacity = linear_opacity(static_cast<double>(a.value.opacity[target]), true);
  opacity = opacity < 1 - 1e-6 ? opacity : 1 - 1e-6;
  double split = split_opacity(opacity, n);
  const double factor = split_scale(opacity, split, n);
  split = split > kDeadOpacity ? split : static_cast<double>(kDeadOpacity);
  a.value.opacity[target] = static_cast<float>(std::log(split / (1 - split)));
  for (uint64_t k = 4 * target; k < 4 * target + 3; ++k) {
    a.value.log_scale[k] += static_cast<float>(std::log(factor));
  }
  reset_row(s, a, target);
}

// Row i becomes what `target` is; its id stays.
L4D_HOST_DEVICE inline void copy_row(const DensityStep& s, const DensityArrays& a, uint64_t target,
                                     uint64_t i) {
  const Rows<float>& x = a.value;
  const auto copy = [&](float* of, uint64_t width) {
    for (uint64_t k = 0; k < width; ++k) of[width * i + k] = of[width * target + k];
  };
  copy(x.position, 3);
  copy(x.mean_t, 1);
  copy(x.log_scale, 4);
  copy(x.rotor, 8);
  copy(x.opacity, 1);
  copy(x.sh, 3 * (s.sh_degree + 1) * (s.sh_degree + 1));
  if (a.motion != nullptr) copy(a.motion, 3);
  a.coverage[i] = a.coverage[target];
  a.error[i] = a.error[target];
}

// Makes row i a child of `target`, at a sample of its distribution in space and time.
L4D_HOST_DEVICE inline void place_child(const DensityStep& s, const DensityArrays& a,
                                        uint64_t target, uint64_t i) {
  const Rows<float>& x = a.value;
  copy_row(s, a, target, i);

  float n[4], p[3][4], rows[16], scale[4];
  normal4(philox(s.seed, s.step, a.id[i], Use::kChild), n);
  for (int k = 0; k < 4; ++k) scale[k] = std::exp(x.log_scale[4 * i + static_cast<uint64_t>(k)]);
  scaled_rows(normalized_halves(x.rotor + 8 * i), scale, rows);
  const Slice4D<float> slice = slice_rows(rows, p);
  float dt = 0, shift[3] = {0, 0, 0};
  for (int k = 0; k < 4; ++k) {
    dt += kChildDistance * rows[12 + k] * n[k];
    for (int c = 0; c < 3; ++c) shift[c] += kChildDistance * p[c][k] * n[k];
  }
  // Positions are means at the reference time, which moves with the mean time.
  const double before = static_cast<double>(x.mean_t[i]);
  x.mean_t[i] += dt;
  const double after = static_cast<double>(x.mean_t[i]);
  const double move = reference_time(after, s.time_begin, s.time_end) -
                      reference_time(before, s.time_begin, s.time_end);
  for (uint64_t c = 0; c < 3; ++c) {
    x.position[3 * i + c] += shift[c] + slice.velocity[c] * static_cast<float>(move);
  }
  if (uniform(philox(s.seed, s.step, a.id[i], Use::kSplit).v[0]) < s.halve) {
    x.log_scale[4 * i + 3] -= 0.69314718f;
  }
  reset_row(s, a, i);
}

}  // namespace l4d::train
