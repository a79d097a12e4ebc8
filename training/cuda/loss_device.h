// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include "training/step/loss.h"

// The loss of loss.h on a device, for the views of a step together.
namespace l4d::train {

constexpr uint32_t kMaxDeviceViews = 16;

// LossSums, and the derivative by the exposure.
struct DeviceLossSums {
  double absolute, squared, similarity;
  unsigned long long values;
  double by_exposure[12];
  uint32_t ticket;  // 0 between launches
};

// A view; all pointers are to device memory.
struct DeviceLossView {
  LossView<float> view;
  float* factors;        // [9, height, width]
  double* partial;       // [loss_partial_size]
  DeviceLossSums* sums;  // `ticket` is 0 before the first launch
  float* rgb_gradient;   // [height, width, 3]
  float* error;          // [height, width] mean over channels of |rgb - y|, 0 in pixels that do not
                         // count; NULL = not wanted
  float weight;          // of the loss
};

struct DeviceLossBatch {
  uint32_t count;
  DeviceLossView views[kMaxDeviceViews];
};

size_t loss_partial_size(uint32_t width, uint32_t height);

// Factors and sums. *stop becomes 1 where a sum is not finite.
void launch_loss_forward(const DeviceLossBatch& batch, uint32_t* stop, cudaStream_t stream);
// After it: rgb_gradient, error, and by_exposure of views with an exposure.
void launch_loss_backward(const DeviceLossBatch& batch, cudaStream_t stream);

}  // namespace l4d::train
