// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/page_reads.h"

#include <algorithm>
#include <string>
#include <tuple>

#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/container/page.h"

namespace l4d {
namespace {

// Neighbouring parts are read in one call where no more than this lies between them.
constexpr uint64_t kMaxReadGap = 4096;

Status check_hash(ByteSpan bytes, const ChunkRef& chunk, const char* what) {
  if (hash64(bytes) == chunk.hash) return {};
  return Status(L4D_ERR_CHECKSUM, "CHNK-2", chunk.offset,
                std::string("checksum of ") + what + " does not match");
}

}  // namespace

void PageReads::clear() {
  parts_.clear();
  runs_.clear();
}

void PageReads::add(const PageRecord& record, size_t page, bool with_detail) {
  parts_.push_back({record.chunk, page, false});
  if (with_detail && record.has_sh_detail()) parts_.push_back({record.sh_detail, page, true});
}

void PageReads::finish(uint64_t max_gap) {
  // In the order of pages, where parts begin at the same byte: a stable sort takes more code.
  std::sort(parts_.begin(), parts_.end(), [](const PageChunk& a, const PageChunk& b) {
    return std::tie(a.chunk.offset, a.page, a.detail) < std::tie(b.chunk.offset, b.page, b.detail);
  });
  runs_.clear();
  for (size_t i = 0; i < parts_.size(); ++i) {
    const ChunkRef& chunk = parts_[i].chunk;
    if (!runs_.empty()) {
      ChunkRun& run = runs_.back();
      const uint64_t end = run.offset + run.bytes;
      const bool near = chunk.offset >= end && chunk.offset - end <= max_gap;
      if (near && chunk.offset + chunk.stored_bytes - run.offset <= kMaxReadBytes) {
        run.bytes = chunk.offset + chunk.stored_bytes - run.offset;
        run.end = i + 1;
        continue;
      }
    }
    runs_.push_back({chunk.offset, chunk.stored_bytes, i, i + 1});
  }
}

uint64_t PageReads::bytes() const {
  uint64_t bytes = 0;
  for (const ChunkRun& run : runs_) bytes += run.bytes;
  return bytes;
}

uint64_t max_read_gap(const ByteSource& source, const Plan& plan, bool with_detail) {
  if (source.has_gaps()) return 0;
  // What lies between may be the very parts that are not wanted.
  return !with_detail && plan.sh_bytes > 0 ? 0 : kMaxReadGap;
}

Status check_page_chunk(const SceneHeader& header, const PageRecord& record, bool detail,
                        ByteSpan bytes) {
  const uint64_t most = max_page_bytes(header, record.num_gaussians);
  if (detail) {
    if (bytes.size() > most) {
      return corrupt("CHNK-8", record.sh_detail.offset, "SH detail longer than its content can be");
    }
    return check_hash(bytes, record.sh_detail, "the SH detail of a page");
  }
  const ChunkRef& chunk = record.chunk;
  L4D_RETURN_IF_ERROR(check_hash(bytes, chunk, "a page"));
  if (!is_rans_page(record)) return {};  // decode_chunk() knows the sizes of the others
  if (chunk.raw_bytes != chunk.stored_bytes) {
    return corrupt("CHNK-3", chunk.offset, "rANS page whose sizes differ");
  }
  if (chunk.stored_bytes > most) {
    return corrupt("CHNK-8", chunk.offset, "rANS page longer than its content can be");
  }
  return {};
}

}  // namespace l4d
