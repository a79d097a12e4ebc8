// SPDX-License-Identifier: Apache-2.0
// What all device code shares: errors of the CUDA runtime as Status, and owners of device memory.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <utility>

#include "l4d/cuda.h"
#include "libl4dcodec/base/status.h"

namespace l4d::cuda {

// "what: cudaErrorName: description". Out of memory keeps its own code, and so does what the device
// cannot run; anything else is L4D_ERR_DEVICE.
Status device_error(cudaError_t error, const char* what);

#define L4D_RETURN_IF_CUDA_ERROR(expr)                          \
  do {                                                          \
    const cudaError_t l4d_cuda_error_ = (expr);                 \
    if (l4d_cuda_error_ != cudaSuccess) {                       \
      return ::l4d::cuda::device_error(l4d_cuda_error_, #expr); \
    }                                                           \
  } while (0)

// Devices that the runtime sees; 0 where there is no driver.
int device_count();
Status describe_device(int device, l4d_cuda_device_info* out);
// Makes `device` the calling thread's, and fails with a reason where this build has no code for it.
Status use_device(int device);

// The calling thread's device for the length of a scope; afterwards it is the one that it was.
class DeviceScope {
 public:
  DeviceScope();
  ~DeviceScope() {
    if (before_ >= 0) static_cast<void>(cudaSetDevice(before_));
  }
  DeviceScope(const DeviceScope&) = delete;
  DeviceScope& operator=(const DeviceScope&) = delete;

  // A device that use_device() found usable.
  Status enter(int device);

 private:
  int before_ = -1;
};

// Memory of one owner, which only grows.
template <cudaError_t (*kAllocate)(void**, size_t), cudaError_t (*kFree)(void*)>
class GrowingMemory {
 public:
  GrowingMemory() = default;
  GrowingMemory(GrowingMemory&& other) noexcept { *this = std::move(other); }
  GrowingMemory& operator=(GrowingMemory&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~GrowingMemory() { kFree(data_); }

  // What was in it is lost where it has to grow. Work that still uses it must be done.
  Status reserve(size_t bytes) {
    if (bytes <= size_) return {};
    kFree(data_);
    data_ = nullptr;
    size_ = 0;
    const cudaError_t error = kAllocate(&data_, bytes);
    if (error != cudaSuccess) return device_error(error, "allocating memory");
    size_ = bytes;
    return {};
  }
  void* data() const { return data_; }
  size_t size() const { return size_; }
  template <typename T>
  T* as() const {
    return static_cast<T*>(data_);
  }

 private:
  void* data_ = nullptr;
  size_t size_ = 0;
};

using DeviceMemory = GrowingMemory<cudaMalloc, cudaFree>;
// Host memory that copies to and from the device can run beside other work from.
using PinnedMemory = GrowingMemory<cudaMallocHost, cudaFreeHost>;

}  // namespace l4d::cuda
