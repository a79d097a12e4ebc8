// SPDX-License-Identifier: Apache-2.0
// From attributes in device arrays to resident rows.
#pragma once

#include "render/cuda/layout.h"

namespace l4d::render {

// The sequence, in seconds.
struct Sequence {
  double begin, end;
  double center() const { return begin + 0.5 * (end - begin); }
};

// Rows of one motion group that follow each other.
struct Slab {
  uint32_t first, count, group;
};
constexpr uint32_t kMaxSlabs = 256;

// Sorts [0, gaussians.count) by motion group, each group in order: lists [kNumMotionGroups, count] and
// their lengths counts [kNumMotionGroups]. states: [kNumMotionGroups, pieces of kGroupPiece] and then a
// ticket, set to 0.
constexpr uint32_t kGroupPiece = 256;
void launch_group(const l4d_gaussians& gaussians, const Sequence& sequence, uint32_t* lists,
                  uint32_t* counts, uint32_t* states, cudaStream_t stream);

// Makes rows [first, first + count) of Gaussians list[0], ..., or, where list is NULL, 0, 1, ...; ids
// are those numbers plus first_id.
void launch_store(const l4d_gaussians& gaussians, const Sequence& sequence, const uint32_t* list,
                  uint32_t count, uint32_t first, uint32_t first_id, bool half_sh,
                  const ResidentRows& rows, cudaStream_t stream);

// Returns how many chunks the slabs are; chunks has room for them.
uint32_t num_chunks(const Slab* slabs, uint32_t num_slabs);
void launch_chunks(const Slab* slabs, uint32_t num_slabs, Chunk* chunks, cudaStream_t stream);

}  // namespace l4d::render
