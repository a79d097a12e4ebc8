// SPDX-License-Identifier: Apache-2.0
// The kernels of a scene that changes in every step.
#pragma once

#include "render/cuda/frame/frame.h"

namespace l4d::render {

// What a trainable scene counts; device memory that is set to 0 when a scene is set.
struct TrainableCounts {
  unsigned long long views, skipped;
  uint32_t rows;
  uint32_t required_visible, required_instances;
  uint32_t visible, projected, instances;  // of the first view
};

// All slots from the attributes, slot i from row i. count: [1] rows in use, NULL: all of them.
// Others, and those that are not finite, are never visible.
void launch_refresh(const l4d_gaussians& gaussians, const uint32_t* count, const Sequence& sequence,
                    const ResidentGaussians& slots, TrainableCounts* counts, cudaStream_t stream);
// Counts a frame that has been made. overflow: becomes 1 where it lacks something; or NULL.
void launch_note_view(const FrameMemory& memory, bool first, TrainableCounts* counts,
                      uint32_t* overflow, cudaStream_t stream);

}  // namespace l4d::render
