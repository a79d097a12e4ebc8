// SPDX-License-Identifier: Apache-2.0
#include "training/model/state_hash.h"

#include <xxhash.h>

#include <algorithm>
#include <string>

namespace l4d::train {

uint64_t hash_of(const ModelState& state) {
  const auto rows = static_cast<size_t>(state.count);
  uint64_t hash = state.count ^ static_cast<uint64_t>(state.next_id) << 32;
  for_each_column(
      [&](const std::string&, size_t numbers, const auto& column) {
        // A back end may leave out what it does not have.
        const size_t count = std::min(column.size(), rows * numbers);
        hash = XXH3_64bits_withSeed(column.data(), count * sizeof(column[0]), hash);
      },
      state);
  return hash;
}

}  // namespace l4d::train
