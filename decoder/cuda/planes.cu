// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/kernels.h"
#include "decoder/cuda/planes.cuh"

namespace l4d::cuda {
namespace {

__global__ void __launch_bounds__(32 * kMaxBlockPages) planes_kernel(const DeviceJob job) {
  extern __shared__ uint4 shared[];
  decode_planes(job, reinterpret_cast<unsigned char*>(shared));
}

}  // namespace

uint32_t planes_shared_bytes(const DeviceLayer& layer, uint32_t block_pages) {
  return PlanesLayout(layer.num_tables, layer.num_planes, layer.map_bytes, block_pages).bytes;
}

cudaError_t launch_planes(const DeviceJob& job, const PlanesLaunch& launch, cudaStream_t stream) {
  if (launch.num_blocks == 0) return cudaSuccess;
  const cudaError_t error =
      cudaFuncSetAttribute(planes_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize,
                           static_cast<int>(launch.shared_bytes));
  if (error != cudaSuccess) return error;
  planes_kernel<<<launch.num_blocks, 32 * launch.block_pages, launch.shared_bytes, stream>>>(job);
  return cudaGetLastError();
}

}  // namespace l4d::cuda
