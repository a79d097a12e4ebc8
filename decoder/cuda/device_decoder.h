// SPDX-License-Identifier: Apache-2.0
// What an l4d_cuda_decoder handle is: a decoder's stream, its tables on a device, and the job at
// hand.
#pragma once

#include <cstdint>

#include "decoder/cuda/job.h"
#include "decoder/decoder.h"
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
  Status prepare(const l4d_query& query, l4d_cuda_job* job);
  const Plan* plan() const { return prepared_ ? &job_->plan() : nullptr; }
  Status upload(void* workspace, uint64_t workspace_size, cudaStream_t stream);
  Status decode(const l4d_cuda_gaussian_buffers& out, void* workspace, uint64_t workspace_size,
                cudaStream_t stream);
  Status finish();

 private:
  Status check_workspace(const void* workspace, uint64_t size) const;
  Status copy_host_rows(const DeviceArrays& out, cudaStream_t stream) const;

  Decoder& decoder_;
  int device_ = -1;
  uint32_t multiprocessors_ = 1;
  std::unique_ptr<LayerTables> tables_;
  std::unique_ptr<Job> job_;
  uint32_t attributes_ = 0;
  bool prepared_ = false;
  const void* uploaded_to_ = nullptr;
  PinnedMemory faults_;
  cudaEvent_t done_ = nullptr;
  bool in_flight_ = false;
  bool decoded_ = false;
};

}  // namespace l4d::cuda
