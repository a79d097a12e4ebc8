// SPDX-License-Identifier: Apache-2.0
// What an l4d_cuda_decoder handle is: a decoder's stream, its tables on a device, and the request
// at hand.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <tuple>

#include "decoder/cuda/prepared_request.h"
#include "decoder/session/decoder.h"
#include "l4d/experimental/cuda_packed.h"
#include "libl4dcodec/cuda/device.h"

namespace l4d::cuda {

class DeviceDecoder {
 public:
  // decoder: its stream is open, and stays so as long as this object.
  explicit DeviceDecoder(Decoder& decoder) : decoder_(decoder) {}
  ~DeviceDecoder();
  DeviceDecoder(const DeviceDecoder&) = delete;
  DeviceDecoder& operator=(const DeviceDecoder&) = delete;

  Status open(int device);
  int device() const { return device_; }

  // As the functions of l4d/cuda.h.
  Status prepare(const l4d_query& query, l4d_cuda_request* request);
  const Plan* plan() const { return prepared_ ? &request_->plan() : nullptr; }
  Status upload(void* workspace, uint64_t workspace_size, cudaStream_t stream);
  Status decode(const l4d_cuda_gaussian_buffers& out, void* workspace, uint64_t workspace_size,
                cudaStream_t stream);
  Status decode_packed(const l4d_cuda_packed_buffers& out, void* workspace, uint64_t workspace_size,
                       cudaStream_t stream);
  Status finish();
  // Of the last decode_packed, finished.
  Status num_escapes(uint64_t* counts) const;
  Status codebook(uint32_t layer, uint32_t component, uint32_t stage, uint32_t block,
                  l4d_codebook* out);

 private:
  struct GivenArray {
    const void* array;
    uint32_t attribute;
  };
  Status check_has_packed_form() const;
  Status check_workspace(const void* workspace, uint64_t size) const;
  // What decode and decode_packed have in common, before and after their kernels.
  Status check_arrays(uint32_t form, uint64_t capacity, const GivenArray* arrays,
                      size_t count) const;
  Status begin_decode(void* workspace, uint64_t workspace_size, cudaStream_t stream);
  Status end_decode(const void* workspace, uint32_t form, cudaStream_t stream);
  Status copy_host_rows(const DeviceArrays& out, cudaStream_t stream) const;
  Status copy_host_windows(const uint32_t* from, uint32_t* to, cudaStream_t stream) const;
  Status copy_packed_host_rows(const PackedArrays& out, cudaStream_t stream) const;
  Status check_escapes() const;

  Decoder& decoder_;
  int device_ = -1;
  uint32_t multiprocessors_ = 1;
  std::unique_ptr<LayerTables> tables_;
  std::unique_ptr<PreparedRequest> request_;
  uint32_t attributes_ = 0;
  uint32_t forms_ = 0;
  bool prepared_ = false;
  const void* uploaded_to_ = nullptr;
  PinnedMemory results_;  // faults and numbers of escapes, as PreparedRequest tells
  // Of the last decode_packed.
  std::array<uint64_t, L4D_COMPONENT_COUNT> escape_capacity_{};
  std::map<std::tuple<uint32_t, uint32_t, uint32_t>, DeviceMemory> block_codebooks_;
  cudaEvent_t done_ = nullptr;
  bool in_flight_ = false;
  uint32_t decoded_ = 0;  // L4D_CUDA_FORM_* of the last decode
  bool finished_ = false;
};

}  // namespace l4d::cuda
