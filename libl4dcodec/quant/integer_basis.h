// SPDX-License-Identifier: Apache-2.0
// The basis of SH as rows are made of it: 16-bit integers and one power of two (spec: "Decoding
// process").
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace l4d {

struct IntegerBasis {
  std::vector<int16_t> vectors;  // [steps.size(), dim]
  float scale = 1;               // power of two: vectors * scale are the basis vectors, times steps
};

// basis: [num_coefficients + 1, dim], the origin first. steps: [num_coefficients].
IntegerBasis integer_basis(const float* basis, size_t dim, const float* steps,
                           size_t num_coefficients);

}  // namespace l4d
