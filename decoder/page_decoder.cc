// SPDX-License-Identifier: Apache-2.0
#include "decoder/page_decoder.h"

#include <algorithm>
#include <atomic>

#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/container/page.h"

namespace l4d {
namespace {

// Pages are read ahead of the parallel part in batches of about this size.
constexpr uint64_t kBatchBytes = uint64_t{32} << 20;
// Neighbouring pages are read in one call where no more than this lies between them.
constexpr uint64_t kMaxReadGap = 4096;
// What a batch notes for each page besides its bytes.
constexpr uint64_t kNotesPerPage =
    sizeof(PageBooks) + sizeof(EntropyTables*) + 2 * sizeof(BlockRecord) + sizeof(Status);

bool is_rans(const PageRecord& record) {
  return record.chunk.codec == static_cast<uint32_t>(ChunkCodec::kRans32);
}

// Bytes between the end of one page and the next that are read with them.
uint64_t gap_between(uint64_t end, const ChunkRef& next) {
  const bool near = next.offset >= end && next.offset - end <= kMaxReadGap;
  return near ? next.offset - end : 0;
}

// Pages of a batch and where their bytes lie.
struct Batch {
  size_t begin = 0;
  size_t end = 0;
  std::vector<Bytes> buffers;
  std::vector<ByteSpan> pages;
};

// With `failed`, one Status for each page, a page that cannot be read does not keep the others from
// being read.
Status read_batch(ByteSource& source, const Plan& plan, Batch* batch, std::vector<Status>* failed) {
  batch->buffers.clear();
  batch->pages.clear();
  // Stored order and file order agree but for interleaved layers, so runs are found by looking ahead.
  for (size_t i = batch->begin; i < batch->end;) {
    const ChunkRef& first = plan.tasks[i].record.chunk;
    uint64_t end = first.offset + first.stored_bytes;
    size_t j = i + 1;
    for (; j < batch->end; ++j) {
      const ChunkRef& next = plan.tasks[j].record.chunk;
      if (next.offset < end || next.offset - end > kMaxReadGap) break;
      end = next.offset + next.stored_bytes;
    }
    batch->buffers.emplace_back();
    ByteSpan run;
    Status status = source.read(first.offset, end - first.offset, batch->buffers.back(), &run);
    if (!status.ok()) {
      if (failed == nullptr) return status;
      batch->buffers.pop_back();
      for (; i < j; ++i) {
        const ChunkRef& c = plan.tasks[i].record.chunk;
        batch->buffers.emplace_back();
        ByteSpan page;
        (*failed)[i - batch->begin] =
            source.read(c.offset, c.stored_bytes, batch->buffers.back(), &page);
        batch->pages.push_back(page);
      }
      continue;
    }
    for (; i < j; ++i) {
      const ChunkRef& c = plan.tasks[i].record.chunk;
      batch->pages.push_back(
          run.subspan(static_cast<size_t>(c.offset - first.offset), c.stored_bytes));
    }
  }
  return {};
}

}  // namespace

DecodeKernels decode_kernels_reference() {
  return {&stream_kernels_reference(), &rans_kernels_reference(),
          {&reconstruct_kernels_reference(), &transform_kernels_reference()}};
}

DecodeKernels decode_kernels_simd() {
  return {&stream_kernels_simd(), &rans_kernels_simd(),
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

const BlockRecord* PageDecoder::block_of(const PageTask& task) const {
  if (task.record.block == kNoBlock) return nullptr;
  return &blocks_.at({{task.layer, task.directory_index}, task.record.block});
}

Status PageDecoder::resolve_books(const PageTask& task, const PageWants& wants, PageBooks* out) {
  const SceneHeader& header = file_.header();
  const LayerHeader& layer = header.layers[task.layer];
  const bool want[L4D_COMPONENT_COUNT] = {wants.sh, wants.scale, wants.rotor, wants.rotor};
  const BlockRecord* block = block_of(task);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (!want[c]) continue;
    const ComponentCoding& coding = header.component(layer, c);
    if (coding.transform()) {
      L4D_RETURN_IF_ERROR(file_.codebook(task.layer, c, 0, &out->book[c][0]));
      continue;
    }
    const size_t stages = coding.stages.size();
    for (unsigned s = 0; s < stages; ++s) {
      if (s == 0 && block != nullptr && block->tables[c].num_entries != 0) {
        L4D_RETURN_IF_ERROR(file_.block_codebook(task.layer, c, task.directory_index,
                                                 task.record.block, &out->book[c][s]));
      } else {
        L4D_RETURN_IF_ERROR(file_.codebook(task.layer, c, s, &out->book[c][s]));
      }
    }
  }
  return {};
}

Status PageDecoder::parse_page(const PageTask& task, ByteSpan bytes, const PageWants& wants,
                               const EntropyTables* tables, PageScratch& scratch,
                               SectionBytes* sections) {
  const ChunkRef& chunk = task.record.chunk;
  if (hash64(bytes) != chunk.hash) {
    return Status(L4D_ERR_CHECKSUM, "CHNK-2", chunk.offset, "checksum of a page does not match");
  }
  ByteSpan raw;
  const SceneHeader& header = file_.header();
  if (tables != nullptr) {
    if (chunk.raw_bytes != chunk.stored_bytes) {
      return corrupt("CHNK-3", chunk.offset, "rANS page whose sizes differ");
    }
    if (chunk.stored_bytes > max_page_bytes(header, task.record.num_gaussians)) {
      return corrupt("CHNK-8", chunk.offset, "rANS page longer than its content can be");
    }
    return decode_rans_page(scratch.rans, bytes, chunk.offset, header, header.layers[task.layer],
                            *tables, block_of(task), task.record.num_gaussians, wants,
                            &scratch.columns, sections);
  }
  L4D_RETURN_IF_ERROR(decode_chunk(scratch.stream, chunk.codec, bytes, chunk.raw_bytes,
                                   max_page_bytes(header, task.record.num_gaussians), chunk.offset,
                                   scratch.storage, &raw));
  return decode_page(scratch.stream, raw, chunk.offset, header, header.layers[task.layer],
                     block_of(task), task.record.num_gaussians, wants, &scratch.columns, sections);
}

Status PageDecoder::find_block(const PageTask& task) {
  if (task.record.block == kNoBlock) return {};
  std::vector<const DirectoryPage*> pages;
  L4D_RETURN_IF_ERROR(
      file_.directory_pages(task.layer, task.directory_index, task.directory_index, &pages));
  // A file that changes under the reader can lose the block between two reads.
  if (pages[0] == nullptr || task.record.block >= pages[0]->blocks.size()) {
    return corrupt("DIR-6", Status::kNoOffset, "a block does not exist any more");
  }
  blocks_[{{task.layer, task.directory_index}, task.record.block}] =
      pages[0]->blocks[task.record.block];
  return {};
}

Status PageDecoder::for_each_page(const Plan& plan, size_t begin, size_t end,
                                  const PageWants& wants, bool need_books, SectionBytes* sections,
                                  const PageBody& body, const Progress& progress, LostPages* lost) {
  if (need_books && wants.sh && begin < end) {
    // Every page needs these: without them there is nothing to go on with.
    const CodebookData* book = nullptr;
    for (unsigned s = 0; s < file_.header().sh.num_books(); ++s) {
      L4D_RETURN_IF_ERROR(
          file_.codebook(plan.tasks[begin].layer, L4D_COMPONENT_SH, s, &book));
    }
  }
  Batch batch;
  batch.end = begin;
  uint64_t done = 0;
  while (batch.end < end) {
    batch.begin = batch.end;
    uint64_t bytes = 0;
    while (batch.end < end && (batch.end == batch.begin || bytes < kBatchBytes)) {
      const PageRecord& record = plan.tasks[batch.end].record;
      if (batch.end > batch.begin) {
        const ChunkRef& last = plan.tasks[batch.end - 1].record.chunk;
        bytes += gap_between(last.offset + last.stored_bytes, record.chunk);
      }
      bytes += kNotesPerPage + record.chunk.stored_bytes +
               std::min<uint64_t>(record.chunk.raw_bytes,
                                  max_page_bytes(file_.header(), record.num_gaussians));
      ++batch.end;
    }
    const size_t n = batch.end - batch.begin;
    MemoryCharge charge(file_.memory());
    L4D_RETURN_IF_ERROR(charge.take(bytes, "a batch of pages"));
    std::vector<Status> status(n);
    L4D_RETURN_IF_ERROR(
        read_batch(file_.source(), plan, &batch, lost == nullptr ? nullptr : &status));
    std::vector<PageBooks> books(n);
    std::vector<const EntropyTables*> tables(n, nullptr);
    blocks_.clear();
    for (size_t i = 0; i < n; ++i) {
      if (!status[i].ok()) continue;
      const PageTask& task = plan.tasks[batch.begin + i];
      status[i] = find_block(task);
      if (status[i].ok() && is_rans(task.record)) {
        status[i] = file_.entropy_tables(task.layer, &tables[i]);
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
        status[i] = parse_page(plan.tasks[batch.begin + i], batch.pages[i], wants, tables[i],
                               *scratch, sections == nullptr ? nullptr : &page_sections);
        if (!status[i].ok()) continue;
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
      if (status[i].ok()) continue;
      if (lost == nullptr || !is_loss(status[i])) return std::move(status[i]);
      lost->push_back({batch.begin + i, std::move(status[i])});
      ++num_lost;
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
  wants.mean_t = out.mean_t != nullptr || out.mean_t_local != nullptr;
  wants.opacity = out.opacity != nullptr;
  wants.scale = out.log_scale != nullptr;
  wants.rotor = out.rotor != nullptr;
  wants.sh = out.sh != nullptr;
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
  return for_each_page(
      plan, 0, plan.tasks.size(), PageWants(), true, nullptr,
      [](size_t, const PageColumns&, const PageBooks&, PageScratch&) {}, nullptr, lost);
}

Status PageDecoder::measure(const Plan& plan, SectionBytes* sections,
                            std::vector<uint64_t>* layer_bytes) {
  PageWants none{false, false, false, false, false, false};
  for (const PageTask& task : plan.tasks) {
    (*layer_bytes)[task.layer] += task.record.chunk.stored_bytes;
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
      const uint64_t share = chunk.raw_bytes == 0 ? 0 : raw[s] * chunk.stored_bytes / chunk.raw_bytes;
      (*sections)[s] += share;
      given += share;
    }
    (*sections)[L4D_SECTION_PAGE_OVERHEAD] += chunk.stored_bytes - given;
  }
  return {};
}

}  // namespace l4d
