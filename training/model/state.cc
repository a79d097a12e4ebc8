// SPDX-License-Identifier: Apache-2.0
#include "training/model/state.h"

#include <algorithm>

namespace l4d::train {

void ModelState::allocate(uint64_t capacity, uint32_t sh_degree) {
  const size_t n = static_cast<size_t>(capacity);
  for (AttributeArrays* arrays : {&value, &m, &v}) {
    *arrays = AttributeArrays();
    arrays->sh_degree = sh_degree;
    arrays->flags = L4D_OPACITY_LOGIT;
    arrays->resize(n);
  }
  for (std::vector<uint32_t>* rows :
       {&id, &updates, &prepared, &born, &last_shown, &screen_views}) {
    rows->assign(n, 0);
  }
  coverage.assign(n, 0);
  error.assign(n, 0);
  screen_gradient.assign(n, 0);
}

void ModelState::keep(const std::vector<uint8_t>& mask) {
  const size_t rows = static_cast<size_t>(capacity());
  std::vector<uint8_t> whole(rows, 0);
  std::copy_n(mask.begin(), count, whole.begin());
  for (AttributeArrays* arrays : {&value, &m, &v}) {
    arrays->keep(whole);
    arrays->resize(rows);
  }
  for (std::vector<uint32_t>* column :
       {&id, &updates, &prepared, &born, &last_shown, &screen_views}) {
    keep_rows(whole, 1, column);
    column->resize(rows);
  }
  for (std::vector<float>* column : {&coverage, &error, &screen_gradient}) {
    keep_rows(whole, 1, column);
    column->resize(rows);
  }
  count = static_cast<uint64_t>(
      std::count_if(whole.begin(), whole.end(), [](uint8_t kept) { return kept != 0; }));
  cumulative.clear();
}

l4d_gaussians ModelState::view() const {
  l4d_gaussians gaussians = value.view();
  gaussians.count = count;
  return gaussians;
}

}  // namespace l4d::train
