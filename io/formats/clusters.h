// SPDX-License-Identifier: Apache-2.0
// Few values that stand for many. Equal input gives equal output on one machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "io/file/memory.h"

namespace l4d::io {

// 256 values in ascending order that lie close to all of these, by squared distance.
std::vector<float> codebook_of(const std::vector<float>& values);
// The value of a codebook that is the nearest.
uint8_t nearest_code(const std::vector<float>& codebook, float value);

// Rows that stand for others, and which of them stands for each.
struct RowPalette {
  std::vector<float> centroids;  // [count, width]
  std::vector<uint32_t> labels;  // [rows]
};
// At most `count` means of rows: those that lie furthest from their mean are divided, again and
// again, across the direction in which they differ most.
RowPalette palette_of(const std::vector<float>& rows /* [N, width] */, size_t width, size_t count,
                      const Check& check = {});

}  // namespace l4d::io
