// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "training/model/state.h"

namespace l4d::train {

// XXH3 of the rows in use: parameters, moments, ids and statistics.
uint64_t hash_of(const ModelState& state);

}  // namespace l4d::train
