// SPDX-License-Identifier: Apache-2.0
// Decoding on a device into arrays of the host: what a decoder of the CUDA backend does.
#pragma once

#include "decoder/cuda/device_decoder.h"

namespace l4d::cuda {

class HostDecode {
 public:
  // decoder: its stream is open, and stays so as long as this object.
  explicit HostDecode(Decoder& decoder)
      : sh_dim_(decoder.file().header().sh_dim()), device_(decoder) {}

  Status open(int device) { return device_.open(device); }
  // As Decoder::decode of one that is not tolerant.
  Status decode(const l4d_query& query, l4d_gaussian_buffers* out);

 private:
  size_t sh_dim_;
  DeviceDecoder device_;
  DeviceMemory memory_;  // arrays, then the workspace
};

}  // namespace l4d::cuda
