// SPDX-License-Identifier: Apache-2.0
// Kernels that begin before the one in front of them on the stream has ended. Devices from compute
// capability 9.0 on can do that; on others the calls do nothing, and kernels follow each other.
#pragma once

#include <cuda_runtime.h>

namespace l4d::cuda {

// Lets the next kernel on the stream begin once all blocks of this one have called it.
__device__ inline void let_next_begin() {
#if __CUDA_ARCH__ >= 900
  cudaTriggerProgrammaticLaunchCompletion();
#endif
}

// Waits until the kernel in front has ended and what it wrote can be read.
__device__ inline void wait_for_previous() {
#if __CUDA_ARCH__ >= 900
  cudaGridDependencySynchronize();
#endif
}

// Whether the calling thread's device runs code that was compiled for 9.0 or above. Other code does
// not wait, so that it must not be launched early.
inline bool can_overlap() {
  int device = 0, major = 0, minor = 0;
  return cudaGetDevice(&device) == cudaSuccess &&
         cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, device) == cudaSuccess &&
         cudaDeviceGetAttribute(&minor, cudaDevAttrComputeCapabilityMinor, device) == cudaSuccess &&
         10 * major + minor >= L4D_CUDA_MIN_OVERLAPPING;
}

}  // namespace l4d::cuda
