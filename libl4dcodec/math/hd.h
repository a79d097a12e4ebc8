// SPDX-License-Identifier: Apache-2.0
#pragma once

// What lets one header serve the host compiler and the CUDA compiler. The headers of this folder
// use nothing of the standard library that device code lacks.
#if defined(__CUDACC__)
#define L4D_HOST_DEVICE __host__ __device__
#else
#define L4D_HOST_DEVICE
#endif

#include <cmath>

namespace l4d {

// Correctly rounded on both sides: the decoded result depends on it.
L4D_HOST_DEVICE inline float square_root(float x) {
#if defined(__CUDA_ARCH__)
  return __fsqrt_rn(x);
#else
  return std::sqrt(x);
#endif
}

L4D_HOST_DEVICE inline double square_root(double x) {
#if defined(__CUDA_ARCH__)
  return __dsqrt_rn(x);
#else
  return std::sqrt(x);
#endif
}

}  // namespace l4d
