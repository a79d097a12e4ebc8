// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "training/model/rows.h"

// Density control by relocation (Kheradmand et al. 2024), a part of the rows in every step, or more
// of them in fewer steps: all rows come up once in kCycle steps. Rows that are dead move to others,
// and the model grows towards its budget. Contract of relocate.cc (reference) and relocate.cu; both
// call the functions of density/relocate_row.h.
namespace l4d::train {

constexpr uint32_t kCycle = 100;
constexpr float kDeadOpacity = 0.005f;

struct DensityStep {
  uint64_t seed = 0;
  uint64_t step = 0;
  uint64_t count = 0;  // Gaussians
  // Rows whose id is `turn` modulo `cycle` are treated.
  uint32_t cycle = kCycle, turn = 0;
  uint64_t births = 0;  // rows to add at the end, at most; capacity holds them
  uint32_t sh_degree = 0;
  // Births have the ids from here on, `births` of them whether all find a target or not. Relocated
  // rows keep their ids.
  uint32_t next_id = 0;
  double time_begin = 0, time_end = 0;  // of the sequence, s
  // A row that no view of the steps since `unseen_since` shows is dead. 0 = none is dead for that.
  uint32_t unseen_since = 0;
  // With this probability the temporal standard deviation of a child is half that of its parent.
  float halve = 0.5f;
  // Rows that are pulled to and fro in time at least this much are split (temporal_split.h), before
  // other rows get children. 0 = none.
  float split_above = 0;
};

struct DensityArrays {
  Rows<float> value, m, v;                   // [capacity]
  uint32_t *updates, *prepared, *born, *id;  // [capacity], as in AdamArrays
  uint32_t* last_shown;                      // [capacity] the last step that showed the row
  float *coverage, *error;                   // [capacity] moving averages, see statistics.h
  // [capacity] the sum of derivatives by the mean time, that of their magnitudes, and the steps
  // that showed the row, since the row was made or judged; null where nothing is split.
  float *time_gradient = nullptr, *time_magnitude = nullptr;
  uint32_t* time_visits = nullptr;
  float* motion = nullptr;  // [capacity, 3] as in AdamArrays, or null
  // [sampled] running sums of the weights by which targets are drawn, renewed every kCycle steps.
  const double* cumulative;
  uint64_t sampled;
};

struct DensityChange {
  uint64_t relocated = 0;
  uint64_t born = 0;
  uint64_t split = 0;  // in time, each of them with one of the rows above
};
DensityChange change_density(const DensityStep& step, const DensityArrays& arrays);

// Fills `cumulative` [count] with the running sums of opacity (1 + beta e), where e is the error
// per coverage of the row over the mean of that.
void accumulate_weights(const Rows<const float>& value, const float* coverage, const float* error,
                        uint64_t count, float beta, std::vector<double>* cumulative);

}  // namespace l4d::train
