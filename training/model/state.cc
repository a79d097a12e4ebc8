// SPDX-License-Identifier: Apache-2.0
#include "training/model/state.h"

namespace l4d::train {

void ModelState::allocate(uint64_t capacity, uint32_t sh_degree) {
  const size_t n = static_cast<size_t>(capacity);
  for (AttributeArrays* arrays : {&value, &m, &v}) {
    *arrays = AttributeArrays();
    arrays->sh_degree = sh_degree;
    arrays->flags = L4D_OPACITY_LOGIT;
    arrays->resize(n);
  }
  for (std::vector<uint32_t>* rows : {&id, &updates, &prepared, &born, &last_shown}) {
    rows->assign(n, 0);
  }
  coverage.assign(n, 0);
  error.assign(n, 0);
}

l4d_gaussians ModelState::view() const {
  l4d_gaussians gaussians = value.view();
  gaussians.count = count;
  return gaussians;
}

}  // namespace l4d::train
