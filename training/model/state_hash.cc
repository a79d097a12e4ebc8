// SPDX-License-Identifier: Apache-2.0
#include "training/model/state_hash.h"

#include <xxhash.h>

namespace l4d::train {

uint64_t hash_of(const ModelState& state) {
  const auto rows = static_cast<size_t>(state.count);
  uint64_t hash = state.count ^ static_cast<uint64_t>(state.next_id) << 32;
  const auto add = [&](const auto& column, size_t width) {
    hash = XXH3_64bits_withSeed(column.data(), rows * width * sizeof(column[0]), hash);
  };
  for (const AttributeArrays* arrays : {&state.value, &state.m, &state.v}) {
    for_each_attribute([&](const AttributeInfo& a,
                           const std::vector<float>& v) { add(v, a.numbers(state.sh_degree())); },
                       *arrays);
  }
  for (const std::vector<uint32_t>* column :
       {&state.id, &state.updates, &state.prepared, &state.born, &state.last_shown,
        &state.screen_views}) {
    add(*column, 1);
  }
  for (const std::vector<float>* column : {&state.coverage, &state.error, &state.screen_gradient}) {
    add(*column, 1);
  }
  return hash;
}

}  // namespace l4d::train
