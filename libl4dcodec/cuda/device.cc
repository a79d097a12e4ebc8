// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/cuda/device.h"

#include <algorithm>
#include <cstdio>
#include <string>

#include "libl4dcodec/base/c_api.h"

namespace l4d::cuda {
namespace {

// The lowest compute capability that device code is built for: 90 is 9.0.
constexpr int kMinArchitecture = L4D_CUDA_MIN_ARCHITECTURE;

std::string capability(int major, int minor) {
  return std::to_string(major) + "." + std::to_string(minor);
}

}  // namespace

Status device_error(cudaError_t error, const char* what) {
  // A failed launch or allocation is reported once; if it stayed, the next call would fail for it.
  static_cast<void>(cudaGetLastError());
  const l4d_status code =
      error == cudaErrorMemoryAllocation ? L4D_ERR_OUT_OF_MEMORY : L4D_ERR_DEVICE;
  return Status(
      code, std::string(what) + ": " + cudaGetErrorName(error) + ": " + cudaGetErrorString(error));
}

int device_count() {
  int count = 0;
  if (cudaGetDeviceCount(&count) == cudaSuccess) return count;
  static_cast<void>(cudaGetLastError());
  return 0;
}

Status describe_device(int device, l4d_cuda_device_info* out) {
  l4d_cuda_device_info info{};
  info.struct_size = sizeof(info);
  cudaDeviceProp properties;
  L4D_RETURN_IF_CUDA_ERROR(cudaGetDeviceProperties(&properties, device));
  std::snprintf(info.name, sizeof(info.name), "%s", properties.name);
  info.compute_major = static_cast<uint32_t>(properties.major);
  info.compute_minor = static_cast<uint32_t>(properties.minor);
  info.multiprocessors = static_cast<uint32_t>(properties.multiProcessorCount);
  info.memory_bytes = properties.totalGlobalMem;
  info.usable = properties.major * 10 + properties.minor >= kMinArchitecture;
  api::write_struct(info, out);
  return {};
}

Status use_device(int device) {
  const int count = device_count();
  if (count == 0) {
    return Status(L4D_ERR_DEVICE,
                  "there is no CUDA device, or no driver for it; use another backend");
  }
  if (device < 0 || device >= count) {
    return Status(L4D_ERR_DEVICE, "there is no CUDA device " + std::to_string(device) +
                                      "; there are " + std::to_string(count));
  }
  l4d_cuda_device_info info{};
  info.struct_size = sizeof(info);
  L4D_RETURN_IF_ERROR(describe_device(device, &info));
  if (info.usable == 0) {
    return Status(
        L4D_ERR_DEVICE,
        std::string(info.name) + " has compute capability " +
            capability(static_cast<int>(info.compute_major), static_cast<int>(info.compute_minor)) +
            ", and this build needs " + capability(kMinArchitecture / 10, kMinArchitecture % 10));
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(device));
  return {};
}

DeviceScope::DeviceScope() {
  if (cudaGetDevice(&before_) == cudaSuccess) return;
  static_cast<void>(cudaGetLastError());
  before_ = -1;
}

Status DeviceScope::enter(int device) {
  L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(device));
  return {};
}

}  // namespace l4d::cuda
