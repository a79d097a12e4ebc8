// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace l4d {

// Indices of points in order of their label, ascending within one; start [k + 1].
struct Cells {
  std::vector<uint32_t> index;
  std::vector<size_t> start;
};

inline Cells sort_into_cells(const std::vector<uint32_t>& labels, size_t k) {
  Cells cells;
  cells.start.assign(k + 1, 0);
  for (const uint32_t label : labels) ++cells.start[label + 1];
  for (size_t c = 0; c < k; ++c) cells.start[c + 1] += cells.start[c];
  cells.index.resize(labels.size());
  std::vector<size_t> next(cells.start.begin(), cells.start.end() - 1);
  for (size_t i = 0; i < labels.size(); ++i) {
    cells.index[next[labels[i]]++] = static_cast<uint32_t>(i);
  }
  return cells;
}

}  // namespace l4d
