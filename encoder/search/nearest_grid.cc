// SPDX-License-Identifier: Apache-2.0
#include "encoder/search/nearest_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace l4d {
namespace {

// Numbers further out than this many times their root mean square are few, and would make the grid
// coarse for all others.
constexpr double kMaxReach = 32;

// The largest integers whose squared distances, 4 x dim x most^2, are below 2^31.
int32_t largest_integer(size_t dim) {
  return static_cast<int32_t>(
      std::min(4095.0, std::floor(std::sqrt(0x1p29 / static_cast<double>(dim + 1)) - 1)));
}

// Distance from the origin, in one axis, that the grid has to reach.
double reach_of(const NearestGrid& grid, const float* sample, size_t count) {
  double largest = 0, squares = 0;
  size_t finite = 0;
  const auto add = [&](const float* rows, size_t n) {
    for (size_t i = 0; i < n * grid.dim; ++i) {
      const double v = static_cast<double>(rows[i]) - grid.origin[i % grid.dim];
      if (!std::isfinite(v)) continue;
      largest = std::max(largest, std::fabs(v));
      squares += v * v;
      ++finite;
    }
  };
  add(grid.codebook, grid.k);
  add(sample, count);
  const double rms = std::sqrt(squares / static_cast<double>(std::max<size_t>(finite, 1)));
  return std::min(largest, kMaxReach * rms);
}

}  // namespace

NearestGrid::NearestGrid(const float* entries, size_t num_codewords, size_t dimensions,
                         const float* sample, size_t count)
    : codebook(entries),
      k(num_codewords),
      dim(dimensions),
      most(largest_integer(dimensions)),
      origin(dimensions, 0.0) {
  for (size_t j = 0; j < dim; ++j) {
    double sum = 0, finite = 0;
    for (size_t c = 0; c < k; ++c) {
      const double v = static_cast<double>(codebook[c * dim + j]);
      if (!std::isfinite(v)) continue;
      sum += v;
      ++finite;
    }
    origin[j] = finite > 0 ? sum / finite : 0.0;
  }
  const double reach = reach_of(*this, sample, count);
  if (reach > 0) step = reach / static_cast<double>(most);

  std::vector<int32_t> place(k * dim, 0);
  for (size_t c = 0; c < k; ++c) {
    bool inside = true;
    double squares = 0;
    for (size_t j = 0; j < dim; ++j) {
      const double v = static_cast<double>(codebook[c * dim + j]) - origin[j];
      const double at = std::nearbyint(v / step);
      inside = inside && std::fabs(at) <= static_cast<double>(most);
      if (!inside) break;
      place[c * dim + j] = static_cast<int32_t>(at);
      const double e = v - at * step;
      squares += e * e;
    }
    (inside ? order : far).push_back(static_cast<uint32_t>(c));
    if (inside) largest_error = std::max(largest_error, std::sqrt(squares));
  }

  const size_t slots = num_groups() * kGroup;
  cells = hwy::AllocateAligned<int16_t>(std::max<size_t>(1, slots * num_pairs() * 2));
  norms = hwy::AllocateAligned<int32_t>(std::max<size_t>(1, slots));
  std::fill_n(cells.get(), slots * num_pairs() * 2, int16_t{0});
  std::fill_n(norms.get(), slots, std::numeric_limits<int32_t>::max());
  for (size_t s = 0; s < order.size(); ++s) {
    int32_t norm = 0;
    for (size_t j = 0; j < dim; ++j) {
      const int32_t at = place[order[s] * dim + j];
      norm += at * at;
      const size_t pair = (s / kGroup * num_pairs() + j / 2) * kGroup + s % kGroup;
      cells[pair * 2 + j % 2] = static_cast<int16_t>(-2 * at);
    }
    norms[s] = norm;
  }
}

}  // namespace l4d
