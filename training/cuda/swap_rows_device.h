// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "training/model/rows.h"
#include "training/model/span.h"

// Moves rows of arrays on a device; contract of swap_rows.cu.
namespace l4d::train {

// Row from[k] of `in` becomes row to[k] of `out`, for k < count. from, to: NULL = k. words: of 4
// bytes, of a row. in and out must not overlap.
void launch_move_rows(const uint32_t* in, const uint32_t* from, uint32_t* out, const uint32_t* to,
                      uint64_t count, uint32_t words, cudaStream_t stream);

// As span_of, of `count` rows.
void launch_spans(const Rows<float>& value, const uint32_t* id, uint64_t count, RowSpan* spans,
                  cudaStream_t stream);

}  // namespace l4d::train
