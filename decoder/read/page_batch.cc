// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/page_batch.h"

#include <algorithm>

#include "decoder/expand/expand.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/container/planes.h"

namespace l4d {
namespace {

// Pages are read ahead of the parallel part in batches of about this size.
constexpr uint64_t kBatchBytes = uint64_t{32} << 20;
// Neighbouring parts are read in one call where no more than this lies between them.
constexpr uint64_t kMaxReadGap = 4096;
// What is noted for each page besides its bytes.
constexpr uint64_t kNotesPerPage =
    sizeof(PageBooks) + sizeof(EntropyTables*) + 2 * sizeof(BlockRecord) + 4 * sizeof(Status);

}  // namespace

size_t PageBatch::run_end(size_t i, uint64_t* run) const {
  *run = parts[i].chunk.offset + parts[i].chunk.stored_bytes;
  for (++i; i < parts.size(); ++i) {
    const ChunkRef& next = parts[i].chunk;
    if (next.offset < *run || next.offset - *run > max_gap) break;
    *run = next.offset + next.stored_bytes;
  }
  return i;
}

uint64_t PageBatch::choose_next(const SceneHeader& header, const Plan& plan, size_t last,
                                bool with_detail) {
  begin = end;
  parts.clear();
  uint64_t bytes = 0;
  for (; end < last && (end == begin || bytes < kBatchBytes); ++end) {
    const PageRecord& record = plan.tasks[end].record;
    bytes +=
        kNotesPerPage + record.chunk.stored_bytes +
        std::min<uint64_t>(record.chunk.raw_bytes, max_page_bytes(header, record.num_gaussians));
    parts.push_back({record.chunk, end - begin, false});
    if (!with_detail || !record.has_sh_detail()) continue;
    bytes += record.sh_detail.stored_bytes;
    parts.push_back({record.sh_detail, end - begin, true});
  }
  std::stable_sort(parts.begin(), parts.end(), [](const PagePart& a, const PagePart& b) {
    return a.chunk.offset < b.chunk.offset;
  });
  // What lies between may be the very parts that are not wanted.
  max_gap = !with_detail && plan.sh_bytes > 0 ? 0 : kMaxReadGap;
  bytes += parts.size() * sizeof(PagePart);
  for (size_t i = 0; i < parts.size();) {
    uint64_t gaps = 0;
    const uint64_t first = parts[i].chunk.offset;
    for (const size_t next = run_end(i, &gaps); i < next; ++i) gaps -= parts[i].chunk.stored_bytes;
    bytes += gaps - first;
  }
  return bytes;
}

Status PageBatch::read(ByteSource& source, bool tolerant) {
  const size_t n = end - begin;
  buffers.clear();
  pages.assign(n, ByteSpan());
  details.assign(n, ByteSpan());
  status.assign(n, Status());
  detail_status.assign(n, Status());
  for (size_t i = 0; i < parts.size();) {
    uint64_t run_bytes = 0;
    const size_t next = run_end(i, &run_bytes);
    const uint64_t first = parts[i].chunk.offset;
    run_bytes -= first;
    buffers.emplace_back();
    ByteSpan run;
    Status failure = source.read(first, run_bytes, buffers.back(), &run);
    if (failure.ok()) {
      for (; i < next; ++i) {
        const ChunkRef& c = parts[i].chunk;
        set_read(parts[i], run.subspan(static_cast<size_t>(c.offset - first), c.stored_bytes));
      }
      continue;
    }
    if (!tolerant) return failure;
    buffers.pop_back();
    for (; i < next; ++i) {
      const PagePart& part = parts[i];
      buffers.emplace_back();
      ByteSpan bytes;
      (part.detail ? detail_status : status)[part.page] =
          source.read(part.chunk.offset, part.chunk.stored_bytes, buffers.back(), &bytes);
      set_read(part, bytes);
    }
  }
  return {};
}

}  // namespace l4d
