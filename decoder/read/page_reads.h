// SPDX-License-Identifier: Apache-2.0
// How the pages of a plan are read: which parts of them, in which calls, and what must hold of the
// bytes before they are decoded. A value: its owner may read at any time and in any way.
#pragma once

#include <vector>

#include "decoder/read/plan.h"
#include "decoder/read/source.h"

namespace l4d {

// One of the parts of a page.
struct PageChunk {
  ChunkRef chunk;
  size_t page = 0;  // what the one who added it calls its page
  bool detail = false;
};

// Parts [first, end) of PageReads, which are read in one call.
struct ChunkRun {
  uint64_t offset = 0, bytes = 0;
  size_t first = 0, end = 0;
};

class PageReads {
 public:
  void clear();
  // The wanted parts of a page. Each part carries the number `page`.
  void add(const PageRecord& record, size_t page, bool with_detail);
  // After the last add(): brings the parts in the order of the file, and those into one run that
  // lie no more than `max_gap` bytes apart.
  void finish(uint64_t max_gap);

  const std::vector<PageChunk>& parts() const { return parts_; }
  const std::vector<ChunkRun>& runs() const { return runs_; }
  // Of all runs: parts and what lies between them.
  uint64_t bytes() const;

 private:
  std::vector<PageChunk> parts_;
  std::vector<ChunkRun> runs_;
};

// Gap that reads of a plan's pages, all of them or some, may bridge.
uint64_t max_read_gap(const ByteSource& source, const Plan& plan, bool with_detail);

inline ByteSpan bytes_of_chunk(const ChunkRun& run, ByteSpan run_bytes, const PageChunk& part) {
  return run_bytes.subspan(static_cast<size_t>(part.chunk.offset - run.offset),
                           part.chunk.stored_bytes);
}

inline bool is_rans_page(const PageRecord& record) {
  return record.chunk.codec == static_cast<uint32_t>(ChunkCodec::kRans32);
}

// What can be said of a part from its bytes and its record alone: the hash, and of rANS pages the
// sizes.
Status check_page_chunk(const SceneHeader& header, const PageRecord& record, bool detail,
                        ByteSpan bytes);

}  // namespace l4d
