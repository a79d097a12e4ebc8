// SPDX-License-Identifier: Apache-2.0
// SH codebooks of a scene, and what it takes to keep slots as indices of their codewords.
#pragma once

#include "l4d/experimental/cuda_render.h"
#include "l4d/experimental/packed.h"
#include "libl4dcodec/cuda/device.h"
#include "render/cuda/store/indexed.h"

namespace l4d::render {

class ShCodebooks {
 public:
  // Copies them; entries are device pointers. Waits for the device. The room for escapes goes.
  Status set(const l4d_codebook* codebooks, uint32_t count, bool half);
  bool empty() const { return codebooks_.num_stages == 0; }
  uint32_t degree() const { return degree_; }
  const ShCodebookTable& codebooks() const { return codebooks_; }

  // Room for escapes, and for storing at most `slots` slots at once that may be escapes. Waits.
  Status reserve(size_t slots, uint64_t escapes);
  // Looks at the Gaussians of `indices`: what indices of slots are made of, until the next call.
  Status take(const l4d_cuda_sh_indices& indices, uint64_t count, ShIndices* out,
              cudaStream_t stream);

 private:
  ShCodebookTable codebooks_{};
  uint32_t degree_ = 0;
  cuda::DeviceMemory memory_, escapes_, ranks_, rank_states_;
  size_t max_slots_ = 0;
  uint64_t max_escapes_ = 0;
};

}  // namespace l4d::render
