// SPDX-License-Identifier: Apache-2.0
// Columns to all attributes but SH (spec: "Reconstruction"), in the order of operations of
// decoder/expand/expand.cc. A block of kExpandThreads threads takes an ExpandTask.
#pragma once

#include "decoder/cuda/components.cuh"
#include "decoder/cuda/values.cuh"
#include "decoder/cuda/windows.cuh"
#include "libl4dcodec/math/rotor.h"
#include "libl4dcodec/scene/attributes.h"

namespace l4d::cuda {

__device__ inline void expand_scale(const DeviceRequest& request, const ExpandBlock& block,
                                    size_t slot, float* to) {
  const DeviceLayer& layer = *block.layer;
  const ComponentSource source(request, block, L4D_COMPONENT_SCALE);
  float row[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  if (layer.permanent != 0) {
    component_row<3>(source, slot, row);
  } else {
    component_row<4>(source, slot, row);
  }
  const float factor = scalar(layer.scale_factor, request.columns.scale_factor, slot);
  for (float& number : row) number = clamp_log_scale(factor + number);
  store4(to, row[0], row[1], row[2], layer.permanent != 0 ? layer.log_scale_t : row[3]);
}

__device__ inline void expand_rotor(const DeviceRequest& request, const ExpandBlock& block,
                                    size_t slot, float* to) {
  const ComponentSource spatial(request, block, L4D_COMPONENT_ROTOR_SPATIAL);
  const ComponentSource temporal(request, block, L4D_COMPONENT_ROTOR_TEMPORAL);
  float rotor[8];
  if (block.layer->stereographic != 0) {
    float u[3], v[3] = {0.0f, 0.0f, 0.0f}, a[3], b[3];
    component_row<3>(spatial, slot, u);
    if (temporal.is(ComponentCodingId::kTransform)) component_row<3>(temporal, slot, v);
    for (unsigned k = 0; k < 3; ++k) {
      a[k] = on_stereographic_grid(u[k] + v[k]);
      b[k] = on_stereographic_grid(u[k] - v[k]);
    }
    RotorHalves<float> halves;
    half_of_stereographic(a, halves.a);
    half_of_stereographic(b, halves.b);
    rotor_of_halves(halves, rotor);
  } else {
    float coded[8];
    component_row<4>(spatial, slot, coded);
    component_row<4>(temporal, slot, coded + 4);
    normalize_rotor(coded, rotor);
  }
  store4(to, rotor[0], rotor[1], rotor[2], rotor[3]);
  store4(to + 4, rotor[4], rotor[5], rotor[6], rotor[7]);
}

__device__ inline void expand_position(const DeviceLayer& layer, uint64_t code, float* to) {
  for (unsigned axis = 0; axis < 3; ++axis) {
    const uint32_t coded = morton_axis(code >> axis);
    const float number = layer.position_fixed != 0 ? static_cast<float>(coded)
                                                   : half_to_float(unordered_half(coded));
    to[axis] = layer.position_center[axis] + layer.position_scale * number;
  }
}

__device__ inline float local_mean_time(const DeviceRequest& request, const DeviceLayer& layer,
                                        float width, size_t slot) {
  if (layer.mean_t_coded == 0) return 0.0f;
  const uint16_t code = request.columns.mean_t[slot];
  if (layer.mean_t_coded != static_cast<uint32_t>(CoordinateCodingId::kFixed)) {
    return width * half_to_float(code);
  }
  return fixed_mean_time(layer.mean_t_step, layer.mean_t_zero, code,
                         layer.mean_t_fine != 0 ? request.columns.mean_t_fine[slot] : uint16_t{0});
}

// The mean time of a window is its middle. kWindows: some layers of the request are flat.
template <bool kWindows>
__device__ void expand_times(const DeviceRequest& request, const ExpandBlock& block,
                             const DeviceArrays& out, size_t slot, size_t gaussian) {
  const DeviceLayer& layer = *block.layer;
  const double center = block.page->center;
  FrameWindow window;
  float local;
  double mean;
  if (kWindows && layer.flat != 0) {
    window = window_of(request, layer, *block.page, slot);
    mean = window_middle(request.timeline, window);
    local = static_cast<float>(mean - center);
  } else {
    local = local_mean_time(request, layer, block.page->width, slot);
    mean = center + static_cast<double>(local);
  }
  if (out.mean_t_local != nullptr) out.mean_t_local[gaussian] = local;
  if (out.mean_t != nullptr) out.mean_t[gaussian] = static_cast<float>(mean);
  if (out.window != nullptr) store_window(window, gaussian, out.window);
}

// All attributes of Gaussian i of a block but SH and rotor.
template <bool kWindows>
__device__ void expand_place(const DeviceRequest& request, const ExpandBlock& block,
                             const DeviceArrays& out, uint32_t i) {
  const DeviceLayer& layer = *block.layer;
  const size_t slot = block.slot(i), gaussian = block.gaussian(i);
  if (out.position != nullptr) {
    expand_position(layer, request.columns.morton[slot], out.position + 3 * gaussian);
  }
  if (out.mean_t != nullptr || out.mean_t_local != nullptr || out.window != nullptr) {
    expand_times<kWindows>(request, block, out, slot, gaussian);
  }
  if (out.opacity != nullptr) {
    const float opacity = scalar(layer.opacity, request.columns.opacity, slot);
    out.opacity[gaussian] = opacity < layer.min_opacity    ? layer.min_opacity
                            : opacity > layer.most_opacity ? layer.most_opacity
                                                           : opacity;
  }
  if (out.log_scale != nullptr) expand_scale(request, block, slot, out.log_scale + 4 * gaussian);
}

// All attributes but SH. Rotors are half of the work: threads take them apart from the rest.
template <bool kWindows>
__device__ void expand_geometry(const DeviceRequest& request, const DeviceArrays& out,
                                uint32_t index) {
  static_assert(kExpandGaussians % 32 == 0, "a warp does one thing");
  const ExpandBlock block(request, index);
  for (uint32_t e = threadIdx.x; e < 2 * kExpandGaussians; e += kExpandThreads) {
    const uint32_t i = e % kExpandGaussians;
    if (i >= block.count) continue;
    if (e < kExpandGaussians) {
      expand_place<kWindows>(request, block, out, i);
    } else if (out.rotor != nullptr) {
      expand_rotor(request, block, block.slot(i), out.rotor + 8 * block.gaussian(i));
    }
  }
}

}  // namespace l4d::cuda
