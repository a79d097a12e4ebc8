// SPDX-License-Identifier: Apache-2.0
// Flat windows from columns (spec: section 15.6), as libl4dcodec/container/page.h has them.
#pragma once

#include "decoder/cuda/device_types.h"
#include "libl4dcodec/scene/window.h"

namespace l4d::cuda {

// Of a page of a flat layer; nothing says that it is valid.
__device__ inline FrameWindow window_of(const DeviceRequest& request, const DeviceLayer& layer,
                                        const DevicePage& page, size_t slot) {
  const auto part = [&](uint32_t column) {
    return (layer.window_columns >> column & 1) != 0
               ? uint32_t{request.columns.window[column * request.columns.stride + slot]}
               : 0u;
  };
  const uint32_t begin = page.window_base + (part(0) | part(1) << 16);
  return {begin, begin + layer.window_length + (part(2) | part(3) << 16)};
}

// As l4d_gaussian_buffers has them.
__device__ inline void store_window(FrameWindow window, size_t gaussian, uint32_t* to) {
  reinterpret_cast<uint2*>(to)[gaussian] = make_uint2(window.begin, window.end);
}

}  // namespace l4d::cuda
