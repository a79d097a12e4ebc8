// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "training/step/backend.h"

namespace l4d::train {

// The back end of a CUDA device. Targets of steps stay on the device, as far as half of its free
// memory holds them. Throws Error: FEATURE_UNSUPPORTED in a build without device code, DEVICE
// without a device that this build has code for.
std::unique_ptr<Backend> make_cuda_backend(uint32_t device);
// Whether that works for the first device.
bool has_cuda_backend();

// How sums go from device to device. kDirect: kernels use the memory of other devices where they
// can, and copies go between the others.
enum class Transport { kDirect, kCopies };
// A back end of several devices (group_backend.h), one member for each entry; a device may be there
// more than once. Each member keeps the targets that it renders. Throws as make_cuda_backend, and
// INVALID_ARGUMENT unless there are 1 to 8 devices of one kind.
std::unique_ptr<Backend> make_cuda_group(const std::vector<uint32_t>& devices,
                                         Transport transport = Transport::kDirect);

}  // namespace l4d::train
