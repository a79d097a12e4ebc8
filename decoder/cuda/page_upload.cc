// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/page_upload.h"

#include <algorithm>

#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/entropy/rans.h"

namespace l4d::cuda {
namespace {

// What a thread reads and hashes at a time.
constexpr uint64_t kPieceBytes = uint64_t{256} << 10;

template <typename T>
void put(const std::vector<T>& values, const ArrayAt<T>& at, unsigned char* staging) {
  std::copy_n(reinterpret_cast<const unsigned char*>(values.data()), values.size() * sizeof(T),
              staging + at.offset);
}

// The device takes blocks that open; what it finds in them comes back as faults.
Status check_chunk(const SceneHeader& header, const PageRecord& record, bool detail,
                   ByteSpan bytes) {
  L4D_RETURN_IF_ERROR(check_page_chunk(header, record, detail, bytes));
  RansLanes lanes;
  return open_rans_block(bytes, detail ? record.sh_detail.offset : record.chunk.offset, &lanes);
}

}  // namespace

Status PageUpload::fill(const DecodeRequest& request, const WarpSchedule& schedule,
                        const HostPages& host, const WorkspaceLayout& layout,
                        MemoryCharge* charge) {
  if (layout.upload_bytes == 0) return {};
  L4D_RETURN_IF_ERROR(charge->take(layout.upload_bytes, "the upload of a decode"));
  L4D_RETURN_IF_ERROR(staging_.reserve(static_cast<size_t>(layout.upload_bytes)));
  unsigned char* const to = staging_.as<unsigned char>();
  const uint64_t head_bytes = layout.num_escapes.offset + WorkspaceLayout::kNumEscapesBytes;
  std::fill_n(to, head_bytes, static_cast<unsigned char>(0));
  put(placed_pages(request, layout), layout.pages, to);
  put(schedule.warps, layout.warps, to);
  put(schedule.blocks, layout.blocks, to);
  put(request.expands(), layout.expands, to);
  put(placed_host_pieces(file_.header(), request, host, layout), layout.host_pieces, to);
  put(host.escapes(), layout.host_escapes, to);
  for (size_t b = 0; b < layout.codebooks.size(); ++b) {
    put(request.codebooks()[b]->entries, layout.codebooks[b], to);
  }
  return read_chunks(request, layout);
}

// Each part straight to its place, by several threads; or, where the reader takes one call at a
// time and each may cost much, run by run.
Status PageUpload::read_chunks(const DecodeRequest& request, const WorkspaceLayout& layout) {
  unsigned char* const to = staging_.as<unsigned char>();
  const std::vector<PageChunk>& parts = request.reads().parts();
  std::vector<Status> status(2 * request.pages().size());  // [pages, 2], as they are decoded
  const auto status_of = [&](const PageChunk& part) -> Status& {
    return status[2 * part.page + (part.detail ? 1 : 0)];
  };
  const auto check = [&](size_t p) {
    const PageChunk& part = parts[p];
    return check_chunk(file_.header(), request.task_of(part.page).record, part.detail,
                       ByteSpan(layout.parts[p].in(to), part.chunk.stored_bytes));
  };
  ByteSource& source = file_.source();
  if (source.reads_apart()) {
    uint64_t bytes = 0;
    for (const PageChunk& part : parts) bytes += part.chunk.stored_bytes;
    source.count_reads(parts.size(), bytes);
    const size_t grain = bytes == 0 ? 1 : static_cast<size_t>(parts.size() * kPieceBytes / bytes);
    parallel_for(threads_, parts.size(), grain, [&](size_t first, size_t last) {
      for (size_t p = first; p < last; ++p) {
        const ChunkRef& chunk = parts[p].chunk;
        Status& s = status_of(parts[p]);
        s = source.read_apart(chunk.offset, chunk.stored_bytes, layout.parts[p].in(to));
        if (s.ok()) s = check(p);
      }
    });
  } else {
    for (const ChunkRun& run : request.reads().runs()) {
      MemoryCharge charge(file_.memory());
      L4D_RETURN_IF_ERROR(charge.take(run.bytes, "a batch of pages"));
      ByteSpan run_bytes;
      L4D_RETURN_IF_ERROR(source.read(run.offset, run.bytes, read_buffer_, &run_bytes));
      for (size_t p = run.first; p < run.end; ++p) {
        const ByteSpan bytes = bytes_of_chunk(run, run_bytes, parts[p]);
        std::copy(bytes.begin(), bytes.end(), layout.parts[p].in(to));
      }
    }
    parallel_for(threads_, parts.size(), 4, [&](size_t first, size_t last) {
      for (size_t p = first; p < last; ++p) status_of(parts[p]) = check(p);
    });
  }
  const auto failed =
      std::find_if(status.begin(), status.end(), [](const Status& s) { return !s.ok(); });
  return failed == status.end() ? Status() : std::move(*failed);
}

}  // namespace l4d::cuda
