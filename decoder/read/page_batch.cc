// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/page_batch.h"

#include <algorithm>

#include "libl4dcodec/container/page.h"

namespace l4d {

uint64_t PageBatch::choose_next(const SceneHeader& header, const Plan& plan, size_t last,
                                bool with_detail, uint64_t max_gap, uint64_t notes) {
  begin = end;
  reads.clear();
  uint64_t bytes = 0;  // stored, decoded and noted
  uint64_t stored = 0;
  for (; end < last && (end == begin || bytes < kMaxReadBytes); ++end) {
    const PageRecord& record = plan.tasks[end].record;
    const uint64_t parts =
        uint64_t{record.chunk.stored_bytes} + (with_detail ? record.sh_detail.stored_bytes : 0);
    bytes += notes + 4 * sizeof(Status) + parts;
    bytes +=
        std::min<uint64_t>(record.chunk.raw_bytes, max_page_bytes(header, record.num_gaussians));
    stored += parts;
    reads.add(record, end - begin, with_detail);
  }
  reads.finish(max_gap);
  const uint64_t gaps = reads.bytes() - stored;
  return bytes + gaps + reads.parts().size() * (sizeof(PageChunk) + sizeof(ChunkRun));
}

bool PageBatch::is_fetched_in_parts(const ByteSource& source, const ChunkRun& run) const {
  if (source.is_fetched(run.offset, run.bytes)) return false;
  for (size_t i = run.first; i < run.end; ++i) {
    const ChunkRef& chunk = reads.parts()[i].chunk;
    if (!source.is_fetched(chunk.offset, chunk.stored_bytes)) return false;
  }
  return true;
}

void PageBatch::read_chunks(ByteSource& source, const ChunkRun& run) {
  for (size_t i = run.first; i < run.end; ++i) {
    const PageChunk& part = reads.parts()[i];
    buffers.emplace_back();
    (part.detail ? detail_status : status)[part.page] =
        source.read(part.chunk.offset, part.chunk.stored_bytes, buffers.back(),
                    &(part.detail ? details : pages)[part.page]);
  }
}

Status PageBatch::read(ByteSource& source, bool tolerant) {
  const size_t n = end - begin;
  buffers.clear();
  pages.assign(n, ByteSpan());
  details.assign(n, ByteSpan());
  status.assign(n, Status());
  detail_status.assign(n, Status());
  for (const ChunkRun& run : reads.runs()) {
    if (source.fetches() && is_fetched_in_parts(source, run)) {
      read_chunks(source, run);
      continue;
    }
    buffers.emplace_back();
    ByteSpan bytes;
    const Status failure = source.read(run.offset, run.bytes, buffers.back(), &bytes);
    if (!failure.ok()) {
      if (!tolerant) return failure;
      buffers.pop_back();
      read_chunks(source, run);
      continue;
    }
    for (size_t i = run.first; i < run.end; ++i) {
      const PageChunk& part = reads.parts()[i];
      (part.detail ? details : pages)[part.page] = bytes_of_chunk(run, bytes, part);
    }
  }
  return {};
}

}  // namespace l4d
