// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/expand_geometry.cuh"
#include "decoder/cuda/expand_sh.cuh"
#include "decoder/cuda/kernels.h"
#include "libl4dcodec/cuda/overlap.cuh"

namespace l4d::cuda {
namespace {

// Geometry waits for memory, and SH for arithmetic: they go side by side. As soon as all blocks of
// geometry run, those of SH, which do not depend on them, begin on idle multiprocessors; they
// end after the last of geometry, so that whatever comes next on the stream finds both.
template <bool kWindows>
__global__ void __launch_bounds__(kExpandThreads)
    geometry_kernel(const DeviceRequest request, const DeviceArrays out) {
  let_next_begin();
  expand_geometry<kWindows>(request, out, blockIdx.x);
}

template <unsigned kDim>
__global__ void __launch_bounds__(kExpandThreads, 3)
    transform_kernel(const DeviceRequest request, const DeviceArrays out) {
  __shared__ TransformShared<kDim> shared;
  expand_sh_transform<kDim>(request, out, blockIdx.x, shared);
  wait_for_previous();
}

template <unsigned kDim>
__global__ void __launch_bounds__(kExpandThreads)
    rows_kernel(const DeviceRequest request, const DeviceArrays out) {
  expand_sh_rows<kDim, kDim % 4 == 0 ? 4 : 1>(request, out, blockIdx.x);
  wait_for_previous();
}

template <unsigned kDim>
cudaError_t launch_sh(const DeviceRequest& request, const ExpandLaunch& launch,
                      const DeviceArrays& out, bool beside_geometry, cudaStream_t stream) {
  cudaLaunchAttribute early{};
  early.id = cudaLaunchAttributeProgrammaticStreamSerialization;
  early.val.programmaticStreamSerializationAllowed = 1;
  cudaLaunchConfig_t config{};
  config.gridDim = dim3(launch.num_blocks);
  config.blockDim = dim3(kExpandThreads);
  config.stream = stream;
  config.attrs = &early;
  config.numAttrs = beside_geometry && can_overlap() ? 1 : 0;
  return cudaLaunchKernelEx(
      &config, launch.sh_transform ? transform_kernel<kDim> : rows_kernel<kDim>, request, out);
}

bool has_geometry(const DeviceArrays& out) {
  return out.position != nullptr || out.mean_t != nullptr || out.mean_t_local != nullptr ||
         out.window != nullptr || out.log_scale != nullptr || out.rotor != nullptr ||
         out.opacity != nullptr;
}

}  // namespace

cudaError_t launch_expand(const DeviceRequest& request, const ExpandLaunch& launch,
                          const DeviceArrays& out, cudaStream_t stream) {
  if (launch.num_blocks == 0) return cudaSuccess;
  const bool geometry = has_geometry(out);
  if (geometry) {
    const auto kernel = launch.windows ? geometry_kernel<true> : geometry_kernel<false>;
    kernel<<<launch.num_blocks, kExpandThreads, 0, stream>>>(request, out);
    const cudaError_t error = cudaGetLastError();
    if (error != cudaSuccess) return error;
  }
  if (out.sh == nullptr) return cudaSuccess;
  switch (launch.sh_dim) {
    case 3:
      return launch_sh<3>(request, launch, out, geometry, stream);
    case 12:
      return launch_sh<12>(request, launch, out, geometry, stream);
    case 27:
      return launch_sh<27>(request, launch, out, geometry, stream);
    case 48:
      return launch_sh<48>(request, launch, out, geometry, stream);
    default:
      return cudaErrorInvalidValue;
  }
}

}  // namespace l4d::cuda
