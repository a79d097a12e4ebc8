// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

namespace l4d::cuda {

// Whether there is a kernel for vectors of this many numbers.
bool nearest_has_kernel(size_t dim);

// labels [n], sq_dist [n] of points [n, dim] to codebook [k, dim], all on the device. With keep,
// what labels and sq_dist hold stays unless a codeword is strictly nearer; first_label is that of
// codeword 0.
cudaError_t launch_nearest(const float* points, size_t n, size_t dim, const float* codebook,
                           size_t k, uint32_t first_label, bool keep, uint32_t* labels,
                           float* sq_dist, cudaStream_t stream);

}  // namespace l4d::cuda
