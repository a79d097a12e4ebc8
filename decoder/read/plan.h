// SPDX-License-Identifier: Apache-2.0
// Which pages a query needs, in stored order, from the directory alone.
#pragma once

#include <memory>
#include <vector>

#include "decoder/read/query_buckets.h"
#include "decoder/read/scene_file.h"
#include "l4d/decode.h"

namespace l4d {

class Losses;

struct PageTask {
  PageRecord record;
  uint32_t layer = 0;
  uint32_t directory_index = 0;
  uint32_t span = 0;   // index in Plan.ranges
  uint64_t first = 0;  // first Gaussian in the decoded arrays
  uint64_t first_in_bucket = 0;
  DirectoryPageRef directory;  // of which the record names a block, else null

  const BlockRecord* block() const {
    return directory == nullptr ? nullptr : &directory->page.blocks[record.block];
  }
  BlockId block_id() const { return {layer, directory_index, record.block}; }
};

// Working memory of make_plan.
struct PlanScratch {
  struct Extent {
    uint64_t begin, end;
  };
  QueryBuckets buckets;
  std::vector<DirectoryPageRef> pages, fresh;
  std::vector<DirectoryCache::Failure> failures;
  std::vector<Extent> parts;
};

struct Plan {
  std::vector<PageTask> tasks;
  std::vector<l4d_bucket_span> spans;
  uint64_t num_gaussians = 0;
  uint32_t detail = L4D_DETAIL_FULL;
  uint64_t bytes = 0;     // of the parts that the detail asks for
  uint64_t sh_bytes = 0;  // of SH chunks, asked for or not
  uint64_t directory_bytes = 0;
  std::unique_ptr<MemoryCharge> memory;  // of tasks, ranges and scratch
  PlanScratch scratch;

  // Empties the plan, and keeps its memory for the next one. Lets go of directory pages.
  void clear();
};

// With `losses`, directory pages that cannot be read are listed there and left out. Allocates
// nothing where an earlier plan in *out was as large, and the directory pages are at hand.
Status make_plan(SceneFile& file, const l4d_query& query, Losses* losses, Plan* out);

// The ids of all Gaussians of a plan, in the order of the decoded arrays.
void write_ids(const Plan& plan, l4d_gaussian_id* out);

// Id of a block, unique in its layer: what l4d_bucket_span.block holds.
inline uint32_t range_block(uint32_t directory_index, uint32_t block) {
  return directory_index << 8 | block;
}

}  // namespace l4d
