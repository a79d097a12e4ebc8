// SPDX-License-Identifier: Apache-2.0
#include "training/model/state_hash.h"

#include <xxhash.h>

namespace l4d::train {

uint64_t hash_of(const ModelState& state) {
  const auto rows = static_cast<size_t>(state.count);
  uint64_t hash = state.count ^ static_cast<uint64_t>(state.next_id) << 32;
  for_each_column(
      [&](const std::string&, size_t numbers, const auto& column) {
        hash = XXH3_64bits_withSeed(column.data(), rows * numbers * sizeof(column[0]), hash);
      },
      state);
  return hash;
}

}  // namespace l4d::train
