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

// Lets the kernel have what its device lends at most. The limit is the kernel's, not that of one
// launch: a smaller one would fail launches of other threads which need more.
cudaError_t allow_shared_memory() {
  int device = 0, most = 0;
  cudaError_t error = cudaGetDevice(&device);
  if (error == cudaSuccess) {
    error = cudaDeviceGetAttribute(&most, cudaDevAttrMaxSharedMemoryPerBlockOptin, device);
  }
  cudaFuncAttributes attributes{};
  if (error == cudaSuccess) error = cudaFuncGetAttributes(&attributes, channels_kernel);
  if (error != cudaSuccess) return error;
  return cudaFuncSetAttribute(channels_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize,
                              most - static_cast<int>(attributes.sharedSizeBytes));
}

}  // namespace

uint32_t channels_shared_bytes(const DeviceLayer& layer, uint32_t block_pages) {
  return PlanesLayout(layer.num_tables, layer.num_channels, layer.map_bytes, block_pages).bytes;
}

cudaError_t launch_channels(const DeviceRequest& request, const ChannelsLaunch& launch,
                            cudaStream_t stream) {
  if (launch.num_blocks == 0) return cudaSuccess;
  const cudaError_t error = allow_shared_memory();
  if (error != cudaSuccess) return error;
  channels_kernel<<<launch.num_blocks, 32 * launch.block_pages, launch.shared_bytes, stream>>>(
      request);
  return cudaGetLastError();
}

}  // namespace l4d::cuda
