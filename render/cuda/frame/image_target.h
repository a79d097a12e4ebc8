// SPDX-License-Identifier: Apache-2.0
// Where frames of a device go and what they count, without a type of CUDA.
#pragma once

#include <cstdint>

#include "l4d/render.h"

namespace l4d::render {

// Device arrays that a frame is drawn into; NULL: not wanted.
struct ImageTarget {
  float* rgb;       // [height, width, 3]
  float* alpha;     // [height, width]
  uint32_t* rgba8;  // [height, width] bytes R G B A, rounded and clamped
};

struct DeviceFrameStats {
  uint64_t visible = 0, projected = 0, instances = 0;
  double seconds[L4D_RENDER_PASS_COUNT] = {};
};

}  // namespace l4d::render
