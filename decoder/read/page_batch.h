// SPDX-License-Identifier: Apache-2.0
// Pages of a plan that are read together, and where their bytes then lie.
#pragma once

#include <vector>

#include "decoder/read/page_reads.h"

namespace l4d {

// Pages [begin, end) of a plan, and their bytes once they are read.
struct PageBatch {
  size_t begin = 0;
  size_t end = 0;
  PageReads reads;  // their pages count from `begin`
  std::vector<Bytes> buffers;
  std::vector<ByteSpan> pages, details;       // [end - begin]
  std::vector<Status> status, detail_status;  // [end - begin]

  // Takes pages from where the batch ended, up to `last`, and chooses what to read of them, over
  // gaps of up to `max_gap` bytes. Returns what that takes in memory, with `notes` bytes for each
  // page.
  uint64_t choose_next(const SceneHeader& header, const Plan& plan, size_t last, bool with_detail,
                       uint64_t max_gap, uint64_t notes);
  // With `tolerant`, a part that cannot be read does not keep the others from being read: its
  // status tells.
  Status read(ByteSource& source, bool tolerant);

 private:
  // Whether the parts of a run are at hand, but what lies between is not.
  bool is_fetched_in_parts(const ByteSource& source, const ChunkRun& run) const;
  // The parts of a run that cannot be read as one, each by itself.
  void read_chunks(ByteSource& source, const ChunkRun& run);
};

}  // namespace l4d
