// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "l4d/attributes.hpp"
#include "training/model/rows.h"

namespace l4d::train {

// Colour of a camera: x = E rgb + b, rows of [3, 4]; with the moments of Adam.
struct Exposure {
  std::array<double, 12> value{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  std::array<double, 12> m{}, v{};
  uint64_t updates = 0;
};

// All that changes while a model is trained. Arrays have `capacity` rows, of which the first
// `count` hold Gaussians; they are allocated once.
struct ModelState {
  AttributeArrays value, m, v;
  std::vector<uint32_t> id, updates, prepared, born, last_shown;
  std::vector<float> coverage, error;  // moving averages per row: see Backend::step
  // Sums over the views since a gradient rule looked at the row, and their number; 0 without one.
  std::vector<float> screen_gradient;
  std::vector<uint32_t> screen_views;
  std::vector<double> cumulative;   // of the draw of targets; as long as the model was then
  std::vector<Exposure> exposures;  // of cameras
  uint64_t count = 0;
  uint32_t next_id = 0;

  void allocate(uint64_t capacity, uint32_t sh_degree);
  // Keeps the Gaussians whose mask is not 0, in their order; arrays keep their capacity. mask:
  // [count].
  void keep(const std::vector<uint8_t>& mask);
  uint64_t capacity() const { return value.count(); }
  uint32_t sh_degree() const { return value.sh_degree; }
  // Borrows the first `count` rows.
  l4d_gaussians view() const;
};

}  // namespace l4d::train
