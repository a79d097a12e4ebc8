// SPDX-License-Identifier: Apache-2.0
// The backward pass of a frame: from pixels to instances, to splats, to the scene.
#pragma once

#include "render/cuda/frame/frame.h"
#include "render/frame/importance_numbers.h"

namespace l4d::render {

// How pixels weigh in the scalar that is derived.
enum class Upstream {
  kOnes,   // the scalar is the sum of all pixels and channels
  kGiven,  // rgb_gradient
  kSigns   // +1 or -1 per pixel and channel, at random
};

struct BackwardTask {
  Upstream upstream;
  const float* rgb_gradient;     // [height, width, 3] of kGiven
  uint64_t signs;                // of kSigns: what makes them, see mix()
  const float* rgb;              // [height, width, 3] the image, background included
  const float* error = nullptr;  // [height, width] of kGiven: what SplatSums::error weighs; NULL: 0
};

// Derivatives by one instance, and by one splat once they are added up: sums over pixels of the
// derivative by ln(alpha) times 1, dx, dy, dx^2, dx dy, dy^2; of the derivative by each channel;
// of alpha times transmittance; and of that times the task's error.
struct alignas(16) SplatSums {
  float one, x, y, coverage;
  float xx, xy, yy, red;
  float green, blue, error, unused;  // not of kOnes, where all channels are alike
};
static_assert(sizeof(SplatSums) == 48, "three words");

struct BackwardMemory {
  // Blocks of threads that share a tile: 2 where images have too few tiles to fill a device.
  uint32_t parts;
  SplatSums* instances;  // [max_instances, parts] by emission
  SplatSums* splats;     // [max_visible]
  uint32_t* shown;       // [max_visible] those that a pixel shows, in any order
  long long* by_view;    // [kViewNumbers, kMagnitudes] parts of derivatives by the view
};

// Instances of a frame made with input.backward. Every emission is written.
void launch_backward(const FrameInput& input, const BackwardTask& task, const uint32_t* values,
                     const FrameMemory& memory, const BackwardMemory& back, cudaStream_t stream);
// Adds up the instances of each splat, in their order. `order`: splats front to back.
void launch_sum_instances(const FrameInput& input, const BackwardTask& task, const uint32_t* order,
                          const FrameMemory& memory, const BackwardMemory& back,
                          cudaStream_t stream);
// Coverage alone, of forward frames: sums of alpha times transmittance in units of kCoverageUnit,
// added to coverage [max_visible], which is 0 before. Whole numbers, so that their order does not
// matter.
constexpr float kCoverageUnit = 0x1p-24f;
void launch_coverage(const FrameInput& input, const uint32_t* values, const FrameMemory& memory,
                     unsigned long long* coverage, cudaStream_t stream);

}  // namespace l4d::render
