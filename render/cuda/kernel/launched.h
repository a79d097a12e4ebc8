// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "libl4dcodec/cuda/device.h"

namespace l4d::render {

// The error of kernels that were launched since the last check, as a status that names `what`.
inline Status launched(const char* what) {
  const cudaError_t error = cudaGetLastError();
  return error == cudaSuccess ? Status() : cuda::device_error(error, what);
}

}  // namespace l4d::render
