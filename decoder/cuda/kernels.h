// SPDX-License-Identifier: Apache-2.0
// Launches of the kernels that decode, for code of the host compiler.
#pragma once

#include <cuda_runtime_api.h>

#include "decoder/cuda/device_types.h"

namespace l4d::cuda {

// Pages that a block of threads decodes at most, a warp each: where tables leave room for one block
// on a multiprocessor, and where they leave room for more.
constexpr uint32_t kMaxBlockPages = 16;
constexpr uint32_t kFewBlockPages = 8;
constexpr uint32_t kSharedBytes = 227 << 10;  // of a multiprocessor
// Shared memory that a block needs for a layer; not more than a device has, whatever the layer.
uint32_t channels_shared_bytes(const DeviceLayer& layer, uint32_t block_pages);

struct ChannelsLaunch {
  uint32_t num_blocks = 0;
  uint32_t block_pages = 0;
  uint32_t shared_bytes = 0;
};
cudaError_t launch_channels(const DeviceRequest& request, const ChannelsLaunch& launch,
                            cudaStream_t stream);

struct ExpandLaunch {
  uint32_t num_blocks = 0;
  unsigned sh_dim = 0;
  bool sh_transform = false;
  bool windows = false;  // some layers are flat
};
cudaError_t launch_expand(const DeviceRequest& request, const ExpandLaunch& launch,
                          const DeviceArrays& out, cudaStream_t stream);

// Columns to packed arrays, and escapes one behind the other; counts of escapes go to the request.
cudaError_t launch_pack(const DeviceRequest& request, const PackedArrays& out, cudaStream_t stream);

}  // namespace l4d::cuda
