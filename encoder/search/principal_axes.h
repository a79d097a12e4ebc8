// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

namespace l4d {

// An orthonormal basis in order of falling variance: rotated = (row - mean) basis keeps distances.
struct PrincipalAxes {
  size_t stride = 0;         // of a basis row: dim rounded up to 16, for SIMD
  std::vector<float> mean;   // [dim]
  std::vector<float> basis;  // [dim, stride], axis j is column j, zero from column dim on
};

// Of rows [n, dim], or of evenly spaced ones where there are many. Empty where values that are not
// numbers leave no axes.
PrincipalAxes find_principal_axes(const float* rows, size_t n, size_t dim);

// out [n, dim]
void rotate_to_axes(const PrincipalAxes& axes, const float* rows, size_t n, size_t dim, int threads,
                    float* out);

}  // namespace l4d
