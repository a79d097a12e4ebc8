// SPDX-License-Identifier: Apache-2.0
// Gaussians that more than one piece of a session holds, as pieces do that were cut out of a
// stream.
#pragma once

#include <vector>

#include "encoder/session/pooled_gaussian.h"
#include "l4d/attributes.hpp"

namespace l4d {

// Compares the rows from `first` on with those before them. Returns a mask of all rows: 0 for those
// that are as one before, which stands for one only. Gaussians are the same if they are so bit for
// bit, but for positions: these are rounded at other times.
std::vector<char> without_known(const AttributeArrays& arrays,
                                const std::vector<PooledGaussian>& rows, size_t first);

}  // namespace l4d
