// SPDX-License-Identifier: Apache-2.0
#include "l4d/cuda.h"

#include "libl4dcodec/base/c_api.h"
#ifdef L4D_HAVE_CUDA
#include "libl4dcodec/cuda/device.h"
#endif

extern "C" {

void l4d_cuda_device_info_init_(l4d_cuda_device_info* info, size_t struct_size) {
  l4d::api::init_struct(info, struct_size, l4d_cuda_device_info{});
}

l4d_status l4d_cuda_get_device_count(uint32_t* count) {
  if (count == nullptr) return L4D_ERR_INVALID_ARGUMENT;
#ifdef L4D_HAVE_CUDA
  *count = static_cast<uint32_t>(l4d::cuda::device_count());
#else
  *count = 0;
#endif
  return L4D_OK;
}

l4d_status l4d_cuda_get_device_info(uint32_t device, l4d_cuda_device_info* info) {
  if (info == nullptr) return L4D_ERR_INVALID_ARGUMENT;
#ifdef L4D_HAVE_CUDA
  if (device >= static_cast<uint32_t>(l4d::cuda::device_count())) return L4D_ERR_INVALID_ARGUMENT;
  return l4d::cuda::describe_device(static_cast<int>(device), info).code();
#else
  static_cast<void>(device);
  return L4D_ERR_FEATURE_UNSUPPORTED;
#endif
}

}  // extern "C"
