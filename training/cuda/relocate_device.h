// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include "training/density/relocate.h"

// Relocation of relocate.h on a device; arrays are in device memory.
namespace l4d::train {

struct RelocationMemory {
  uint64_t* children;  // [capacity, 2] target and row, in any order
  uint32_t* copies;    // [capacity] 0 between launches
  double* partial;     // [weight_partial_size(capacity)]
};
size_t weight_partial_size(uint64_t capacity);

// As change_density. *change becomes what it did.
struct DeviceDensityChange {
  unsigned long long relocated, born;
};
void launch_change_density(const DensityStep& step, const DensityArrays& arrays,
                           const RelocationMemory& memory, DeviceDensityChange* change,
                           cudaStream_t stream);

// As accumulate_weights, to cumulative [count].
void launch_accumulate_weights(const Rows<const float>& value, const float* coverage,
                               const float* error, uint64_t count, float beta, double* partial,
                               double* cumulative, cudaStream_t stream);

}  // namespace l4d::train
