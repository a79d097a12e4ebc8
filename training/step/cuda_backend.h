// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "training/step/backend.h"

namespace l4d::train {

// The back end of a CUDA device. Targets of steps stay on the device, as far as half of its free
// memory holds them. Throws Error: FEATURE_UNSUPPORTED in a build without device code, DEVICE
// without a device that this build has code for.
std::unique_ptr<Backend> make_cuda_backend(uint32_t device);
// Whether that works for the first device.
bool has_cuda_backend();

}  // namespace l4d::train
