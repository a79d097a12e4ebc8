// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/expand.cuh"
#include "decoder/cuda/kernels.h"

namespace l4d::cuda {
namespace {

__global__ void __launch_bounds__(kExpandThreads)
    geometry_kernel(const DeviceJob job, const DeviceArrays out) {
  expand_geometry(job, out, blockIdx.x);
}

// Geometry waits for memory, and SH for arithmetic: blocks of both lie side by side, so that they
// hide each other's waits. kinds: 1 = SH alone, 2 = both.
template <unsigned kDim>
__global__ void __launch_bounds__(kExpandThreads, 2)
    transform_kernel(const DeviceJob job, const DeviceArrays out, uint32_t kinds) {
  __shared__ TransformShared<kDim> shared;
  if (blockIdx.x % kinds == 1) {
    expand_geometry(job, out, blockIdx.x / kinds);
  } else {
    expand_sh_transform<kDim>(job, out, blockIdx.x / kinds, shared);
  }
}

template <unsigned kDim>
__global__ void __launch_bounds__(kExpandThreads)
    rows_kernel(const DeviceJob job, const DeviceArrays out, uint32_t kinds) {
  if (blockIdx.x % kinds == 1) {
    expand_geometry(job, out, blockIdx.x / kinds);
  } else {
    expand_sh_rows<kDim, kDim % 4 == 0 ? 4 : 1>(job, out, blockIdx.x / kinds);
  }
}

template <unsigned kDim>
void launch_sh(const DeviceJob& job, const ExpandLaunch& launch, const DeviceArrays& out,
               uint32_t kinds, cudaStream_t stream) {
  const uint32_t blocks = kinds * launch.num_blocks;
  if (launch.sh_transform) {
    transform_kernel<kDim><<<blocks, kExpandThreads, 0, stream>>>(job, out, kinds);
  } else {
    rows_kernel<kDim><<<blocks, kExpandThreads, 0, stream>>>(job, out, kinds);
  }
}

bool has_geometry(const DeviceArrays& out) {
  return out.position != nullptr || out.mean_t != nullptr || out.mean_t_local != nullptr ||
         out.log_scale != nullptr || out.rotor != nullptr || out.opacity != nullptr;
}

}  // namespace

cudaError_t launch_expand(const DeviceJob& job, const ExpandLaunch& launch, const DeviceArrays& out,
                          cudaStream_t stream) {
  const bool geometry = has_geometry(out);
  if (launch.num_blocks == 0 || (!geometry && out.sh == nullptr)) return cudaSuccess;
  if (out.sh == nullptr) {
    geometry_kernel<<<launch.num_blocks, kExpandThreads, 0, stream>>>(job, out);
    return cudaGetLastError();
  }
  const uint32_t kinds = geometry ? 2 : 1;
  switch (launch.sh_dim) {
    case 3:
      launch_sh<3>(job, launch, out, kinds, stream);
      break;
    case 12:
      launch_sh<12>(job, launch, out, kinds, stream);
      break;
    case 27:
      launch_sh<27>(job, launch, out, kinds, stream);
      break;
    case 48:
      launch_sh<48>(job, launch, out, kinds, stream);
      break;
    default:
      return cudaErrorInvalidValue;
  }
  return cudaGetLastError();
}

}  // namespace l4d::cuda
