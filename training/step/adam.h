// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "training/model/rows.h"

// One step of Adam over the rows of a model, with regularisers, rates, clamps and noise in one
// pass. Contract of adam.cc (reference) and adam.cu, which both call adam_row (step/adam_row.h) for
// each row.
namespace l4d::train {

// Learning rates at a moment of the training; see schedule.h.
struct Rates {
  float position = 0;      // scene units
  float mean_t_floor = 0;  // s; a row's rate is max(mean_t_floor, mean_t_share min(tau, T))
  float mean_t_share = 0;
  float log_scale = 0;
  float rotor = 0;  // spatial part: s b01 b02 b12
  // Temporal part: clamp(rotor_drift / min(tau, T), rotor_floor, rotor). 0 = always `rotor`.
  float rotor_drift = 0;  // scene units, as a rate of positions
  float rotor_floor = 0;
  float opacity = 0;
  float sh_dc = 0;
  float sh_rest = 0;
};

struct AdamStep {
  uint64_t seed = 0;
  uint64_t step = 0;              // of the training, from 1
  uint64_t count = 0;             // Gaussians in the arrays
  uint64_t model_count = 0;       // of the whole model, of which some may be away; 0 = `count`
  uint32_t sh_degree = 0;         // of the arrays
  uint32_t active_sh_degree = 0;  // coefficients above it stay as they are
  // Only rows that the step shows are updated, with the corrections of training/docs/method.md.
  // Otherwise all rows are.
  bool sparse = false;
  Rates rates;
  float opacity_weight = 0;  // loss gets opacity_weight mean(opacity)
  float scale_weight = 0;    // and scale_weight mean(spatial scales), per scene unit
  float entropy_weight = 0;  // and entropy_weight mean(-opacity ln opacity)
  // And consistency_weight mean(|velocity - motion|_1) of the rows that have a motion.
  float consistency_weight = 0;
  float noise = 0;  // factor of the noise on positions; 0 = none
  // The range of values.
  float duration = 1;                             // T, s
  float time_begin = 0;                           // s
  float min_log_scale = -16, max_log_scale = 16;  // spatial axes
  float min_log_sigma = -16, max_log_sigma = 16;  // temporal axis
  float min_mean_t = -1e30f, max_mean_t = 1e30f;  // s
};

// Arrays of `count` rows, all in the same memory as the code that works on them.
struct AdamArrays {
  Rows<float> value;
  Rows<float> m, v;      // first and second moments
  Rows<float> gradient;  // read, then set to 0
  const uint8_t* shown;  // [count] not 0: a view of the step shows the row. Read if sparse
  uint32_t* updates;     // [count] updates since the moments were 0
  uint32_t* prepared;    // [count] the step up to which momentum has been applied
  uint32_t* born;        // [count] the step at which the moments were 0
  const uint32_t* id;    // [count] stable ids: random numbers depend on them
  // [count, 3] the mean velocity of a row's neighbours; NaN: not known. NULL: of no row.
  const float* motion = nullptr;
};

// Rows [begin, end). A row whose derivatives are not all finite is left as it is; the number of
// such rows is returned.
uint64_t adam_rows(const AdamStep& step, const AdamArrays& arrays, uint64_t begin, uint64_t end);

// Before the step is rendered at `time` seconds, if sparse: moves rows that are visible then by the
// momentum of the steps that did not show them. Rows [begin, end).
void catch_up_rows(const AdamStep& step, const AdamArrays& arrays, double time, uint64_t begin,
                   uint64_t end);

}  // namespace l4d::train
