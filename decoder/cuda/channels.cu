// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/channels.cuh"
#include "decoder/cuda/kernels.h"

namespace l4d::cuda {
namespace {

__global__ void __launch_bounds__(32 * kMaxBlockPages)
    channels_kernel(const DeviceRequest request) {
  extern __shared__ uint4 shared[];
  decode_channels(request, reinterpret_cast<unsigned char*>(shared));
}

}  // namespace

uint32_t channels_shared_bytes(const DeviceLayer& layer, uint32_t block_pages) {
  return PlanesLayout(layer.num_tables, layer.num_channels, layer.map_bytes, block_pages).bytes;
}

cudaError_t launch_channels(const DeviceRequest& request, const ChannelsLaunch& launch,
                            cudaStream_t stream) {
  if (launch.num_blocks == 0) return cudaSuccess;
  const cudaError_t error =
      cudaFuncSetAttribute(channels_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize,
                           static_cast<int>(launch.shared_bytes));
  if (error != cudaSuccess) return error;
  channels_kernel<<<launch.num_blocks, 32 * launch.block_pages, launch.shared_bytes, stream>>>(
      request);
  return cudaGetLastError();
}

}  // namespace l4d::cuda
