// SPDX-License-Identifier: Apache-2.0
// The backward pass of frames: owns its memory and launches its kernels.
#pragma once

#include "render/cuda/backward/gradient.h"
#include "render/cuda/frame/device_frame.h"

namespace l4d::render {

// The attributes of a scene on the device as a view needs them.
GradientInput gradient_input(const SceneStore& store, const l4d_gaussians& gaussians, double time,
                             const l4d_camera& camera);

class BackwardPass {
 public:
  // Reserves `frame`, and what its backward pass needs if capacity.backward. Only grows. Waits for
  // the device if it has to.
  Status reserve(const FrameCapacity& capacity, DeviceFrame* frame);
  // After DeviceFrame::draw() with `backward` of the same view, and an image with its background:
  // sums by splat.
  Status run(DeviceFrame* frame, const BackwardTask& task, cudaStream_t stream);
  // After DeviceFrame::draw(): the coverage of each splat, and nothing else.
  Status cover(DeviceFrame* frame, cudaStream_t stream);

  const BackwardMemory& memory() const { return memory_; }
  const unsigned long long* coverage() const { return coverage_.as<unsigned long long>(); }
  // [height, width, 3] of the capacity, for frames whose caller wants no image.
  float* scratch_image() const { return image_.as<float>(); }

 private:
  cuda::DeviceMemory instances_, splats_, shown_, coverage_, by_view_, image_;
  BackwardMemory memory_{};
};

}  // namespace l4d::render
