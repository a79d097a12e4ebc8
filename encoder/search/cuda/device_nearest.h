// SPDX-License-Identifier: Apache-2.0
// The search for the nearest codeword on a CUDA device, from and to arrays of the host.
#pragma once

#include <memory>

#include "encoder/search/nearest.h"
#include "libl4dcodec/base/status.h"

namespace l4d::cuda {

// Touches the device at the first search that is worth it; one that cannot be used leaves all work
// to the host. threads: for copies between the caller's arrays and memory that the device reads.
std::unique_ptr<NearestDevice> make_device_nearest(int device, int threads);

}  // namespace l4d::cuda
