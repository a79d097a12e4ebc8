// SPDX-License-Identifier: Apache-2.0
#include "decoder/expand/page_decoder.h"

#include "decoder/read/page_batch.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/container/page.h"

namespace l4d {
namespace {

bool is_rans(const PageRecord& record) {
  return record.chunk.codec == static_cast<uint32_t>(ChunkCodec::kRans32);
}

Status check_hash(ByteSpan bytes, const ChunkRef& chunk, const char* what) {
  if (hash64(bytes) == chunk.hash) return {};
  return Status(L4D_ERR_CHECKSUM, "CHNK-2", chunk.offset,
                std::string("checksum of ") + what + " does not match");
}

// What is known of a second part before it is decoded.
Status check_detail(ByteSpan bytes, const PageRecord& record, const SceneHeader& header) {
  if (bytes.size() > max_page_bytes(header, record.num_gaussians)) {
    return corrupt("CHNK-8", record.sh_detail.offset, "SH detail longer than its content can be");
  }
  return check_hash(bytes, record.sh_detail, "the SH detail of a page");
}

}  // namespace

DecodeKernels decode_kernels_reference() {
  return {&stream_kernels_reference(),
          &rans_kernels_reference(),
          {&reconstruct_kernels_reference(), &transform_kernels_reference()}};
}

DecodeKernels decode_kernels_simd() {
  return {&stream_kernels_simd(),
          &rans_kernels_simd(),
          {&reconstruct_kernels_simd(), &transform_kernels_simd()}};
}

std::unique_ptr<PageScratch> PageDecoder::take_scratch() {
  {
    std::lock_guard<std::mutex> lock(scratch_mutex_);
    if (!scratch_.empty()) {
      auto s = std::move(scratch_.back());
      scratch_.pop_back();
      return s;
    }
  }
  auto s = std::make_unique<PageScratch>();
  s->stream.kernels = kernels_.stream;
  s->rans.kernels = kernels_.rans;
  s->rans.streams = kernels_.stream;
  return s;
}

void PageDecoder::give_scratch(std::unique_ptr<PageScratch> scratch) {
  std::lock_guard<std::mutex> lock(scratch_mutex_);
  scratch_.push_back(std::move(scratch));
}

Status PageDecoder::resolve_books(const PageTask& task, const PageWants& wants, PageBooks* out) {
  const SceneHeader& header = file_.header();
  const LayerHeader& layer = header.layers[task.layer];
  const bool want[L4D_COMPONENT_COUNT] = {wants.sh, wants.scale, wants.rotor, wants.rotor};
  const BlockRecord* block = task.block();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (!want[c]) continue;
    const ComponentCoding& coding = header.component(layer, c);
    if (coding.transform()) {
      L4D_RETURN_IF_ERROR(file_.codebooks().codebook(task.layer, c, 0, &out->book[c][0]));
      continue;
    }
    const size_t stages = coding.stages.size();
    for (unsigned s = 0; s < stages; ++s) {
      if (s == 0 && block != nullptr && block->tables[c].num_entries != 0) {
        L4D_RETURN_IF_ERROR(file_.codebooks().block_codebook(task.block_id(), c, block->tables[c],
                                                             &out->book[c][s]));
      } else {
        L4D_RETURN_IF_ERROR(file_.codebooks().codebook(task.layer, c, s, &out->book[c][s]));
      }
    }
  }
  return {};
}

Status PageDecoder::parse_page(const PageTask& task, ByteSpan bytes, const ByteSpan* detail,
                               const PageWants& wants, const EntropyTables* tables,
                               PageScratch& scratch, SectionBytes* sections,
                               Status* detail_status) {
  const ChunkRef& chunk = task.record.chunk;
  L4D_RETURN_IF_ERROR(check_hash(bytes, chunk, "a page"));
  ByteSpan raw;
  const SceneHeader& header = file_.header();
  if (tables != nullptr) {
    if (chunk.raw_bytes != chunk.stored_bytes) {
      return corrupt("CHNK-3", chunk.offset, "rANS page whose sizes differ");
    }
    if (chunk.stored_bytes > max_page_bytes(header, task.record.num_gaussians)) {
      return corrupt("CHNK-8", chunk.offset, "rANS page longer than its content can be");
    }
    RansPageParts parts;
    parts.first = bytes;
    parts.first_at = chunk.offset;
    parts.has_detail = task.record.has_sh_detail();
    if (detail != nullptr && detail_status->ok()) {
      *detail_status = check_detail(*detail, task.record, header);
      parts.detail = *detail;
      parts.detail_at = task.record.sh_detail.offset;
    }
    const bool decodes_detail = detail != nullptr && detail_status->ok();
    return decode_rans_page(scratch.rans, parts, header, header.layers[task.layer], *tables,
                            task.block(), task.record.num_gaussians, &scratch.columns, sections,
                            decodes_detail ? detail_status : nullptr);
  }
  L4D_RETURN_IF_ERROR(decode_chunk(scratch.stream, chunk.codec, bytes, chunk.raw_bytes,
                                   max_page_bytes(header, task.record.num_gaussians), chunk.offset,
                                   scratch.storage, &raw));
  return decode_page(scratch.stream, raw, chunk.offset, header, header.layers[task.layer],
                     task.block(), task.record.num_gaussians, wants, &scratch.columns, sections);
}

Status PageDecoder::for_each_page(const Plan& plan, size_t begin, size_t end,
                                  const PageWants& wants, bool need_books, SectionBytes* sections,
                                  const PageBody& body, const Progress& progress, LostPages* lost) {
  if (need_books && wants.sh && begin < end) {
    // Every page needs these: without them there is nothing to go on with.
    const CodebookData* book = nullptr;
    for (unsigned s = 0; s < file_.header().sh.num_books(); ++s) {
      L4D_RETURN_IF_ERROR(
          file_.codebooks().codebook(plan.tasks[begin].layer, L4D_COMPONENT_SH, s, &book));
    }
  }
  const bool with_detail = wants.sh && wants.sh_detail;
  PageBatch batch;
  batch.end = begin;
  uint64_t done = 0;
  while (batch.end < end) {
    const uint64_t bytes = batch.choose_next(file_.header(), plan, end, with_detail);
    const size_t n = batch.end - batch.begin;
    MemoryCharge charge(file_.memory());
    L4D_RETURN_IF_ERROR(charge.take(bytes, "a batch of pages"));
    L4D_RETURN_IF_ERROR(batch.read(file_.source(), lost != nullptr));
    std::vector<Status>& status = batch.status;
    std::vector<Status>& detail_status = batch.detail_status;
    std::vector<PageBooks> books(n);
    std::vector<const EntropyTables*> tables(n, nullptr);
    for (size_t i = 0; i < n; ++i) {
      if (!status[i].ok()) continue;
      const PageTask& task = plan.tasks[batch.begin + i];
      if (is_rans(task.record)) {
        status[i] = file_.codebooks().entropy_tables(task.layer, &tables[i]);
      }
      if (status[i].ok() && need_books) status[i] = resolve_books(task, wants, &books[i]);
      if (!status[i].ok() && (lost == nullptr || !is_loss(status[i]))) return std::move(status[i]);
    }
    std::mutex sections_mutex;
    parallel_for(threads_, n, 1, [&](size_t first, size_t last) {
      auto scratch = take_scratch();
      for (size_t i = first; i < last; ++i) {
        if (!status[i].ok()) continue;
        SectionBytes page_sections{};
        const PageTask& task = plan.tasks[batch.begin + i];
        const bool has_detail = with_detail && task.record.has_sh_detail();
        status[i] = parse_page(task, batch.pages[i], has_detail ? &batch.details[i] : nullptr,
                               wants, tables[i], *scratch,
                               sections == nullptr ? nullptr : &page_sections, &detail_status[i]);
        const bool whole = detail_status[i].ok() || (lost != nullptr && is_loss(detail_status[i]));
        if (!status[i].ok() || !whole) continue;
        if (sections != nullptr) {
          std::lock_guard<std::mutex> lock(sections_mutex);
          for (size_t s = 0; s < page_sections.size(); ++s) (*sections)[s] += page_sections[s];
        }
        body(batch.begin + i, scratch->columns, books[i], *scratch);
      }
      give_scratch(std::move(scratch));
    });
    size_t num_lost = 0;
    for (size_t i = 0; i < n; ++i) {
      const bool detail_only = status[i].ok();
      Status& failure = detail_only ? detail_status[i] : status[i];
      if (failure.ok()) continue;
      if (lost == nullptr || !is_loss(failure)) return std::move(failure);
      lost->push_back({batch.begin + i, std::move(failure), detail_only});
      num_lost += !detail_only;
    }
    done += n;
    pages_decoded_ += n - num_lost;
    if (progress && !progress(done, end - begin)) {
      return Status(L4D_ERR_CANCELLED, "cancelled by the progress callback");
    }
  }
  return {};
}

Status PageDecoder::expand(const Plan& plan, size_t begin, size_t end,
                           const l4d_gaussian_buffers& out, const Progress& progress,
                           LostPages* lost) {
  PageWants wants;
  wants.position = out.position != nullptr;
  wants.mean_t =
      out.mean_t != nullptr || out.mean_t_local != nullptr || out.mean_t_double != nullptr;
  wants.opacity = out.opacity != nullptr;
  wants.scale = out.log_scale != nullptr;
  wants.rotor = out.rotor != nullptr;
  wants.sh = out.sh != nullptr;
  wants.sh_detail = plan.detail == L4D_DETAIL_FULL;
  return for_each_page(
      plan, begin, end, wants, true, nullptr,
      [&](size_t i, const PageColumns& columns, const PageBooks& books, PageScratch& scratch) {
        const PageTask& task = plan.tasks[i];
        PageExpander(file_.header(), file_.header().layers[task.layer], columns, books,
                     kernels_.expand, scratch.expand)
            .run(plan.ranges[task.range], static_cast<size_t>(task.first), out);
      },
      progress, lost);
}

Status PageDecoder::probe(const Plan& plan, LostPages* lost) {
  PageWants wants;
  wants.sh_detail = plan.detail == L4D_DETAIL_FULL;
  return for_each_page(
      plan, 0, plan.tasks.size(), wants, true, nullptr,
      [](size_t, const PageColumns&, const PageBooks&, PageScratch&) {}, nullptr, lost);
}

Status PageDecoder::measure(const Plan& plan, SectionBytes* sections,
                            std::vector<uint64_t>* layer_bytes) {
  PageWants none{false, false, false, false, false, false, false};
  for (const PageTask& task : plan.tasks) {
    const uint64_t detail = task.record.sh_detail.stored_bytes;
    (*layer_bytes)[task.layer] += task.record.chunk.stored_bytes + detail;
    (*sections)[L4D_SECTION_SH] += detail;
  }
  // Pages compressed as a whole have no stored bytes per attribute: theirs are shared out in
  // proportion to the raw bytes.
  for (size_t i = 0; i < plan.tasks.size(); ++i) {
    SectionBytes raw{};
    L4D_RETURN_IF_ERROR(for_each_page(
        plan, i, i + 1, none, false, &raw,
        [](size_t, const PageColumns&, const PageBooks&, PageScratch&) {}, nullptr, nullptr));
    const ChunkRef& chunk = plan.tasks[i].record.chunk;
    uint64_t given = 0;
    for (size_t s = 0; s < raw.size(); ++s) {
      const uint64_t share =
          chunk.raw_bytes == 0 ? 0 : raw[s] * chunk.stored_bytes / chunk.raw_bytes;
      (*sections)[s] += share;
      given += share;
    }
    (*sections)[L4D_SECTION_PAGE_OVERHEAD] += chunk.stored_bytes - given;
  }
  return {};
}

}  // namespace l4d
