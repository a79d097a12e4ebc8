// SPDX-License-Identifier: Apache-2.0
#include "training/step/adam.h"

#include "training/step/adam_row.h"

namespace l4d::train {

uint64_t adam_rows(const AdamStep& step, const AdamArrays& arrays, uint64_t begin, uint64_t end) {
  uint64_t skipped = 0;
  for (uint64_t i = begin; i < end; ++i) skipped += adam_row(step, arrays, i) ? 0U : 1U;
  return skipped;
}

void catch_up_rows(const AdamStep& step, const AdamArrays& arrays, double time, uint64_t begin,
                   uint64_t end) {
  for (uint64_t i = begin; i < end; ++i) catch_up_row(step, arrays, time, i);
}

}  // namespace l4d::train
