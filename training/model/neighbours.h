// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace l4d::train {

struct Neighbour {
  double square;  // of the distance
  size_t point;
};

// Calls body(i, nearest) for each point, in no order and from several threads: the `k` nearest
// others, fewer where there are no more, ascending by distance. No call where there are none.
// positions: [n, dim].
void for_each_neighbourhood(
    const std::vector<float>& positions, size_t dim, size_t k,
    const std::function<void(size_t i, const std::vector<Neighbour>& nearest)>& body);

// Root mean square distance of each point to its `k` nearest neighbours. positions: [n, 3].
std::vector<float> neighbour_distance(const std::vector<float>& positions, uint32_t k);

}  // namespace l4d::train
