// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include "training/step/adam.h"

// Adam of adam.h on a device; arrays are in device memory.
namespace l4d::train {

// What the SH of a row needs of its update, from one kernel to the next.
struct alignas(16) ShUpdate {
  float factor, correct1, correct2;
  uint32_t state;
};

// Rows [0, step.count). Does nothing if *stop is not 0. updates [count]: memory of the call.
// *skipped: rows whose derivatives are not finite are added to it.
void launch_adam(const AdamStep& step, const AdamArrays& arrays, ShUpdate* updates,
                 const uint32_t* stop, unsigned long long* skipped, cudaStream_t stream);
// As catch_up_rows.
void launch_catch_up(const AdamStep& step, const AdamArrays& arrays, double time,
                     cudaStream_t stream);

// What the views of a step showed of each row.
struct ShownRows {
  const uint8_t* shown;
  const float *coverage, *error_coverage;  // sums over the views' pixels; NULL = not measured
  float each;                              // 1 / (pixels of a view times views)
  const float* screen_gradient;            // sum over the views that show the row; NULL likewise
  const uint32_t* views;                   // their number
};
struct RowAverages {
  uint32_t* last_shown;
  float *coverage, *error;  // moving averages
  float* screen_gradient;   // sums
  uint32_t* screen_views;
};
// Notes the step in last_shown, renews the averages of rows with coverage, and adds to the sums.
// Does nothing if *stop is not 0.
void launch_note_shown(const AdamStep& step, const ShownRows& rows, const RowAverages& averages,
                       const uint32_t* stop, cudaStream_t stream);

}  // namespace l4d::train
