// SPDX-License-Identifier: Apache-2.0
// Rows whose SH is given by indices of codewords: from arrays as a decoder leaves them to resident
// slots.
#pragma once

#include "render/cuda/store/store.h"

namespace l4d::render {

// Device arrays of Gaussians 0, 1, ...
struct ShIndices {
  const uint8_t* depth;   // NULL: all stages
  const uint16_t* index;  // [num_stages, stride]
  uint64_t stride;
  const uint32_t* rank;  // escapes before each Gaussian; NULL: there are none
  uint32_t num_escapes;
};

// How many of the Gaussians before each one are escapes. states: pieces of kRankPiece and then a
// ticket, set to 0.
constexpr uint32_t kRankPiece = 256;
void launch_rank_escapes(const uint8_t* depth, uint32_t count, uint32_t* ranks, uint32_t* states,
                         cudaStream_t stream);
// Makes the SH of slots. What lies beyond a codebook is brought back into it.
void launch_store_indices(const ShIndices& indices, const StorePlace& place,
                          const ResidentGaussians& slots, cudaStream_t stream);

// Rows of `numbers` to rows of a stride, the rest 0.
void launch_pad_codebooks(const float* from, uint32_t numbers, uint32_t stride, uint32_t count,
                          bool half, void* to, cudaStream_t stream);
void launch_pad_escapes(const uint16_t* from, uint32_t numbers, uint32_t stride, uint32_t count,
                        uint16_t* to, cudaStream_t stream);

}  // namespace l4d::render
