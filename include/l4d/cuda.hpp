// SPDX-License-Identifier: Apache-2.0
// cuda.hpp: cuda.h for C++17. Functions that can fail throw l4d::Error. Streams of CUDA are void*.
#ifndef L4D_CUDA_HPP
#define L4D_CUDA_HPP

#include <vector>

#include "l4d/cuda.h"
#include "l4d/decode.hpp"

namespace l4d {

// By their numbers; none where there is no driver either. Of a device that cannot be asked, zeros.
inline std::vector<l4d_cuda_device_info> cuda_devices() {
  uint32_t count = 0;
  if (l4d_cuda_get_device_count(&count) != L4D_OK) count = 0;
  std::vector<l4d_cuda_device_info> devices;
  for (uint32_t i = 0; i < count; ++i) {
    l4d_cuda_device_info info = L4D_INIT(l4d_cuda_device_info);
    if (l4d_cuda_get_device_info(i, &info) != L4D_OK) info = L4D_INIT(l4d_cuda_device_info);
    devices.push_back(info);
  }
  return devices;
}

// Borrows `decoder`, as l4d_cuda_decoder_create says.
class CudaDecoderHandle : public Handle<l4d_cuda_decoder, l4d_cuda_decoder_destroy> {
 public:
  explicit CudaDecoderHandle(const DecoderHandle& decoder, uint32_t device = 0)
      : Handle([&](l4d_cuda_decoder** out) {
          return l4d_cuda_decoder_create(decoder.get(), device, out);
        }) {}

  void prepare(const l4d_query& query, l4d_cuda_request* request) {
    check(l4d_cuda_decoder_prepare(get(), &query, request));
  }
  void upload(void* workspace, uint64_t workspace_size, void* stream = nullptr) {
    check(l4d_cuda_decoder_upload(get(), workspace, workspace_size, stream));
  }
  void decode(const l4d_cuda_gaussian_buffers& out, void* workspace, uint64_t workspace_size,
              void* stream = nullptr) {
    check(l4d_cuda_decoder_decode(get(), &out, workspace, workspace_size, stream));
  }
  void finish() { check(l4d_cuda_decoder_finish(get())); }
};

}  // namespace l4d
#endif  // L4D_CUDA_HPP
