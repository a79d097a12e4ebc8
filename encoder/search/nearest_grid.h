// SPDX-License-Identifier: Apache-2.0
// An exact search that looks at all codewords, for vectors which a tree cannot tell apart: those of
// noise, whose distances to most codewords are about the same.
#pragma once

#include <hwy/aligned_allocator.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "encoder/search/nearest_job.h"

namespace l4d {

// Codewords on a grid of integers. Distances between points of the grid are exact in integers, and
// the true ones differ by no more than the two vectors are off the grid. So what is within that of
// the least needs a look in full, and nothing else does.
struct NearestGrid {
  static constexpr size_t kGroup = 32;  // codewords side by side, for SIMD

  // codebook: [k, dim], must outlive the grid. sample: [count, dim], of the points to come, which
  // says how far the grid reaches; points beyond take longer.
  NearestGrid(const float* codebook, size_t k, size_t dim, const float* sample, size_t count);

  size_t num_groups() const { return (order.size() + kGroup - 1) / kGroup; }
  size_t num_pairs() const { return (dim + 1) / 2; }

  const float* codebook;
  size_t k, dim;
  int32_t most = 0;             // magnitude of an integer
  double step = 1;              // of the grid
  std::vector<double> origin;   // [dim]
  double largest_error = 0;     // distance of a codeword in `order` to its place on the grid
  std::vector<uint32_t> order;  // codewords on the grid, ascending
  std::vector<uint32_t> far;    // codewords beyond it, always looked at in full

  // -2 x the integers, [num_groups, num_pairs, kGroup, 2]; spare ones of the last group are 0.
  hwy::AlignedFreeUniquePtr<int16_t[]> cells;
  hwy::AlignedFreeUniquePtr<int32_t[]> norms;  // [num_groups, kGroup] sum of their squares
};

// Searches points [begin, end).
void search_grid(const NearestGrid& grid, const NearestJob& job, size_t begin, size_t end);

}  // namespace l4d
