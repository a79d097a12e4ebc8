// SPDX-License-Identifier: Apache-2.0
// What the two forms of a page have in common.
#pragma once

#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/scene/morton.h"

namespace l4d {

template <typename T>
void grow(std::vector<T>& v, size_t n) {
  if (v.size() < n) v.resize(n);
}

// Coded mean times of f16, in place, to binary16 bits; codes of fixed ones stay. `at`: file offset
// for messages.
Status finish_mean_t(const LayerHeader& layer, const StreamKernels& kernels, size_t n, uint64_t at,
                     uint16_t* values);

// Sets depths, and from them the numbers of indices and escapes.
Status count_depths(const ComponentCoding& coding, const uint16_t* depths, size_t n, uint64_t at,
                    ComponentColumns* out);

// The Morton code of coded position i.
inline uint64_t page_morton(const SceneHeader& header, const PageColumns& columns, size_t i) {
  if (header.position == CoordinateCodingId::kFixed) {
    return morton_code(columns.fixed_position[0][i], columns.fixed_position[1][i],
                       columns.fixed_position[2][i]);
  }
  return morton_code(order_half(columns.position[0][i]), order_half(columns.position[1][i]),
                     order_half(columns.position[2][i]));
}

}  // namespace l4d
