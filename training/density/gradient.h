// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "l4d/render.h"
#include "training/density/relocate.h"
#include "training/model/state.h"

// Density control by gradients (Kerbl et al. 2023, in 4D Yang et al. 2024), to compare: rows that
// images pull sideways are cloned where they are small and split where they are large, faint ones
// go, and now and then all become faint. The model grows as far as its budget.
namespace l4d::train {

struct GradientStep {
  uint64_t seed = 0;
  uint64_t step = 0;
  // Rows whose id is `turn` modulo `cycle` are treated.
  uint32_t cycle = 1, turn = 0;
  uint64_t budget = 0;                  // rows at most
  uint32_t views = 1;                   // of a step: losses are means over them
  double split_above = 0;               // spatial scale, scene units
  double time_begin = 0, time_end = 0;  // of the sequence, s
  bool reset = false;                   // also make all rows faint
};

// Reads and resets screen_gradient and screen_views of the treated rows.
// change.relocated: the rows that were removed.
DensityChange change_density_by_gradient(const GradientStep& step, ModelState* model);

// The length of the derivative of a loss by the projected mean, in units of half the image, from
// that by the mean in the world. mean: of the Gaussian at the time of the view.
double screen_gradient(const l4d_camera& camera, const double mean[3], const float by_mean[3]);

}  // namespace l4d::train
