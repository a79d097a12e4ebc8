// SPDX-License-Identifier: Apache-2.0
// Which parts of pages are read together, and where their bytes then lie.
#pragma once

#include <vector>

#include "decoder/read/plan.h"
#include "decoder/read/source.h"

namespace l4d {

// One of the parts of a page.
struct PagePart {
  ChunkRef chunk;
  size_t page = 0;  // in its batch
  bool detail = false;
};

// Pages [begin, end) of a plan, and their bytes once they are read.
struct PageBatch {
  size_t begin = 0;
  size_t end = 0;
  std::vector<PagePart> parts;  // those to be read, in the order of the file
  uint64_t max_gap = 0;         // between parts that are read in one call
  std::vector<Bytes> buffers;
  std::vector<ByteSpan> pages, details;       // [end - begin]
  std::vector<Status> status, detail_status;  // [end - begin]

  // Takes pages from where the batch ended, up to `last`, and chooses what to read of them. Returns
  // what that takes in memory, notes on each page included.
  uint64_t choose_next(const SceneHeader& header, const Plan& plan, size_t last, bool with_detail);
  // With `tolerant`, a part that cannot be read does not keep the others from being read: its
  // status tells.
  Status read(ByteSource& source, bool tolerant);

 private:
  // One past the last part that is read in one call with part i, and where that ends.
  size_t run_end(size_t i, uint64_t* run) const;
  void set_read(const PagePart& part, ByteSpan bytes) {
    (part.detail ? details : pages)[part.page] = bytes;
  }
};

}  // namespace l4d
