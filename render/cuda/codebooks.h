// SPDX-License-Identifier: Apache-2.0
// SH codebooks of a scene, and what it takes to keep rows as indices of their codewords.
#pragma once

#include "l4d/cuda_render.h"
#include "libl4dcodec/cuda/device.h"
#include "render/cuda/indexed.h"

namespace l4d::render {

class ShCodebooks {
 public:
  // Copies them; entries are device pointers. Waits for the device. The room for literals goes.
  Status set(const l4d_codebook* books, uint32_t count, bool half);
  bool empty() const { return books_.num_stages == 0; }
  uint32_t degree() const { return degree_; }
  const ShBooks& books() const { return books_; }

  // Room for literals, and for storing at most `rows` rows at once that may be literals. Waits.
  Status reserve(size_t rows, uint64_t literals);
  // Looks at the Gaussians of `indices`: what indices of rows are made of, until the next call.
  Status take(const l4d_cuda_sh_indices& indices, uint64_t count, ShIndices* out,
              cudaStream_t stream);

 private:
  ShBooks books_{};
  uint32_t degree_ = 0;
  cuda::DeviceMemory memory_, literals_, ranks_, rank_states_;
  size_t max_rows_ = 0;
  uint64_t max_literals_ = 0;
};

}  // namespace l4d::render
