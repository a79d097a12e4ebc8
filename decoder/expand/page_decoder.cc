// SPDX-License-Identifier: Apache-2.0
#include "decoder/expand/page_decoder.h"

#include "decoder/read/page_batch.h"
#include "l4d/experimental/inspect.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/container/page.h"

namespace l4d {

// Pages that are read together, and what they need besides their bytes: [end - begin].
struct PageDecoder::Batch : PageBatch {
  std::vector<PageCodebooks> codebooks;
  std::vector<const EntropyTables*> tables;  // null unless the page is coded with them
  static constexpr uint64_t kNotes = sizeof(PageCodebooks) + sizeof(EntropyTables*);
};

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

Status PageDecoder::resolve_codebooks(const PageTask& task, const PageWants& wants,
                                      PageCodebooks* out) {
  const SceneHeader& header = file_.header();
  const LayerHeader& layer = header.layers[task.layer];
  const bool want[L4D_COMPONENT_COUNT] = {wants.sh, wants.scale, wants.rotor, wants.rotor};
  const BlockRecord* block = task.block();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (!want[c]) continue;
    const ComponentCoding& coding = header.component(layer, c);
    if (coding.transform()) {
      L4D_RETURN_IF_ERROR(file_.codebooks().codebook(task.layer, c, 0, &out->codebook[c][0]));
      continue;
    }
    const size_t stages = coding.stages.size();
    for (unsigned s = 0; s < stages; ++s) {
      if (s == 0 && block != nullptr && block->tables[c].num_entries != 0) {
        L4D_RETURN_IF_ERROR(file_.codebooks().block_codebook(task.block_id(), c, block->tables[c],
                                                             &out->codebook[c][s]));
      } else {
        L4D_RETURN_IF_ERROR(file_.codebooks().codebook(task.layer, c, s, &out->codebook[c][s]));
      }
    }
  }
  return {};
}

// A page of a batch on its way to columns.
struct PageDecoder::Parsing {
  std::unique_ptr<PageScratch> scratch;
  SectionBytes sections{};
  RansPage rans;  // where it is one: all that decoding it takes
  bool is_rans = false;
};

void PageDecoder::start_rans_page(const Pages& pages, size_t i, Parsing* page, Batch* batch) {
  const PageTask& task = pages.plan.tasks[batch->begin + i];
  RansPage& rans = page->rans;
  page->is_rans = true;
  rans.decoder = &page->scratch->rans;
  rans.block = task.block();
  rans.n = task.record.num_gaussians;
  rans.out = &page->scratch->columns;
  if (pages.sections != nullptr) rans.sections = &page->sections;
  RansPageChunks& parts = rans.parts;
  parts.first = batch->pages[i];
  parts.first_at = task.record.chunk.offset;
  parts.has_detail = task.record.has_sh_detail();
  Status& detail = batch->detail_status[i];
  if (!pages.with_detail() || !parts.has_detail || !detail.ok()) return;
  parts.detail = batch->details[i];
  parts.detail_at = task.record.sh_detail.offset;
  detail = check_page_chunk(file_.header(), task.record, true, parts.detail);
  if (detail.ok()) rans.detail = &detail;
}

Status PageDecoder::finish_page(const Pages& pages, size_t i, PageScratch& scratch,
                                const Batch& batch) {
  symbols_decoded_.fetch_add(scratch.columns.symbols, std::memory_order_relaxed);
  const PageTask& task = pages.plan.tasks[batch.begin + i];
  const LayerHeader& layer = file_.header().layers[task.layer];
  if (layer.flat() && pages.wants.mean_t) {
    L4D_RETURN_IF_ERROR(check_windows(file_.header(), layer, task.record.bucket,
                                      task.record.chunk.offset, scratch.columns));
  }
  return pages.check_rules ? check_rules(pages, i, scratch, batch) : Status();
}

Status PageDecoder::check_rules(const Pages& pages, size_t i, PageScratch& scratch,
                                const Batch& batch) {
  const SceneHeader& header = file_.header();
  const PageTask& task = pages.plan.tasks[batch.begin + i];
  const LayerHeader& layer = header.layers[task.layer];
  const l4d_bucket_span& span = pages.plan.spans[task.span];
  const size_t n = task.record.num_gaussians;
  RuleRows& rows = scratch.rules;
  rows.position.resize(3 * n);
  rows.mean_t.resize(n);
  rows.log_scale.resize(4 * n);
  rows.rotor.resize(8 * n);
  rows.window.resize(layer.flat() ? 2 * n : 0);
  l4d_gaussian_buffers out{};
  out.position = rows.position.data();
  out.mean_t_double = rows.mean_t.data();
  out.log_scale = rows.log_scale.data();
  out.rotor = rows.rotor.data();
  out.window = layer.flat() ? rows.window.data() : nullptr;
  PageExpander(header, layer, scratch.columns, batch.codebooks[i], kernels_.expand, scratch.expand)
      .run(span, 0, out);
  return check_page_rules(header, layer, task.record, span, out, scratch.columns.symbols,
                          &rows.slices);
}

Status PageDecoder::start_page(const Pages& pages, size_t i, Parsing* page, Batch* batch) {
  const SceneHeader& header = file_.header();
  const PageTask& task = pages.plan.tasks[batch->begin + i];
  const ByteSpan bytes = batch->pages[i];
  L4D_RETURN_IF_ERROR(check_page_chunk(header, task.record, false, bytes));
  if (batch->tables[i] != nullptr) {
    start_rans_page(pages, i, page, batch);
    return {};
  }
  const ChunkRef& chunk = task.record.chunk;
  PageScratch& scratch = *page->scratch;
  ByteSpan raw;
  L4D_RETURN_IF_ERROR(decode_chunk(scratch.stream, chunk.codec, bytes, chunk.raw_bytes,
                                   max_page_bytes(header, task.record.num_gaussians), chunk.offset,
                                   scratch.storage, &raw));
  return decode_page(scratch.stream, raw, chunk.offset, header, header.layers[task.layer],
                     task.block(), task.record.num_gaussians, pages.wants, &scratch.columns,
                     pages.sections == nullptr ? nullptr : &page->sections);
}

void PageDecoder::parse_pages(const Pages& pages, size_t first, size_t last, Parsing* parsing,
                              Batch* batch) {
  for (size_t i = first; i < last; ++i) {
    if (batch->status[i].ok()) batch->status[i] = start_page(pages, i, &parsing[i - first], batch);
  }
  const SceneHeader& header = file_.header();
  const auto layer_of = [&](size_t i) { return pages.plan.tasks[batch->begin + i].layer; };
  if (last - first == 2 && parsing[0].is_rans && parsing[1].is_rans &&
      layer_of(first) == layer_of(first + 1)) {
    decode_rans_pages(header, header.layers[layer_of(first)], *batch->tables[first], pages.wants,
                      &parsing[0].rans, &parsing[1].rans);
  } else {
    for (size_t i = first; i < last; ++i) {
      if (!parsing[i - first].is_rans) continue;
      decode_rans_page(header, header.layers[layer_of(i)], *batch->tables[i], pages.wants,
                       &parsing[i - first].rans);
    }
  }
  for (size_t i = first; i < last; ++i) {
    Parsing& page = parsing[i - first];
    if (page.is_rans) batch->status[i] = std::move(page.rans.status);
  }
}

Status PageDecoder::load_shared_codebooks(const Pages& pages) {
  if (!pages.need_codebooks || !pages.wants.sh || pages.begin == pages.end) return {};
  const CodebookData* codebook = nullptr;
  for (unsigned s = 0; s < file_.header().sh.num_codebooks(); ++s) {
    L4D_RETURN_IF_ERROR(file_.codebooks().codebook(pages.plan.tasks[pages.begin].layer,
                                                   L4D_COMPONENT_SH, s, &codebook));
  }
  return {};
}

Status PageDecoder::find_tables(const Pages& pages, Batch* batch) {
  const size_t n = batch->end - batch->begin;
  batch->codebooks.assign(n, PageCodebooks());
  batch->tables.assign(n, nullptr);
  for (size_t i = 0; i < n; ++i) {
    Status& status = batch->status[i];
    if (!status.ok()) continue;
    const PageTask& task = pages.plan.tasks[batch->begin + i];
    if (is_rans_page(task.record)) {
      status = file_.codebooks().entropy_tables(task.layer, &batch->tables[i]);
    }
    if (status.ok() && pages.need_codebooks) {
      status = resolve_codebooks(task, pages.wants, &batch->codebooks[i]);
    }
    if (!status.ok() && (pages.lost == nullptr || !is_loss(status))) return std::move(status);
  }
  return {};
}

void PageDecoder::decode_batch(const Pages& pages, const PageBody& body, Batch* batch) {
  const size_t n = batch->end - batch->begin;
  // Pages go in pairs where that leaves no thread without one.
  const size_t at_once = n >= 4 * static_cast<size_t>(resolve_threads(threads_)) ? 2 : 1;
  std::mutex sections_mutex;
  parallel_for(threads_, n, at_once, [&](size_t first, size_t last) {
    Parsing parsing[2];
    for (size_t i = first; i < last; ++i) parsing[i - first].scratch = take_scratch();
    parse_pages(pages, first, last, parsing, batch);
    for (size_t i = first; i < last; ++i) {
      Parsing& page = parsing[i - first];
      if (batch->status[i].ok()) batch->status[i] = finish_page(pages, i, *page.scratch, *batch);
      const Status& detail = batch->detail_status[i];
      const bool whole = detail.ok() || (pages.lost != nullptr && is_loss(detail));
      if (batch->status[i].ok() && whole) {
        if (pages.sections != nullptr) {
          std::lock_guard<std::mutex> lock(sections_mutex);
          for (size_t s = 0; s < page.sections.size(); ++s)
            (*pages.sections)[s] += page.sections[s];
        }
        body(batch->begin + i, page.scratch->columns, batch->codebooks[i], *page.scratch);
      }
      give_scratch(std::move(page.scratch));
    }
  });
}

Status PageDecoder::collect_failures(const Pages& pages, Batch* batch) {
  const size_t n = batch->end - batch->begin;
  size_t num_lost = 0;
  for (size_t i = 0; i < n; ++i) {
    const bool detail_only = batch->status[i].ok();
    Status& failure = detail_only ? batch->detail_status[i] : batch->status[i];
    if (failure.ok()) continue;
    failure = file_.source().after_check(std::move(failure));
    if (pages.lost == nullptr || !is_loss(failure)) return std::move(failure);
    pages.lost->push_back({batch->begin + i, std::move(failure), detail_only});
    num_lost += !detail_only;
  }
  pages_decoded_ += n - num_lost;
  return {};
}

Status PageDecoder::for_each_page(const Pages& pages, const Progress& progress,
                                  const PageBody& body) {
  L4D_RETURN_IF_ERROR(load_shared_codebooks(pages));
  const ByteSource& source = file_.source();
  const uint64_t max_gap =
      std::max(max_read_gap(source, pages.plan, pages.with_detail()), source.block_bytes());
  Batch batch;
  batch.end = pages.begin;
  while (batch.end < pages.end) {
    const uint64_t bytes = batch.choose_next(file_.header(), pages.plan, pages.end,
                                             pages.with_detail(), max_gap, Batch::kNotes);
    MemoryCharge charge(file_.memory());
    L4D_RETURN_IF_ERROR(charge.take(bytes, "a batch of pages"));
    L4D_RETURN_IF_ERROR(batch.read(file_.source(), pages.lost != nullptr));
    L4D_RETURN_IF_ERROR(find_tables(pages, &batch));
    decode_batch(pages, body, &batch);
    L4D_RETURN_IF_ERROR(collect_failures(pages, &batch));
    if (progress && !progress(batch.end - pages.begin, pages.end - pages.begin)) {
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
  wants.mean_t = out.mean_t != nullptr || out.mean_t_local != nullptr ||
                 out.mean_t_double != nullptr || out.window != nullptr;
  wants.opacity = out.opacity != nullptr;
  wants.scale = out.log_scale != nullptr;
  wants.rotor = out.rotor != nullptr;
  wants.sh = out.sh != nullptr || out.sh_half != nullptr;
  wants.sh_detail = plan.detail == L4D_DETAIL_FULL;
  return for_each_page({plan, begin, end, wants, lost}, progress,
                       [&](size_t i, const PageColumns& columns, const PageCodebooks& codebooks,
                           PageScratch& scratch) {
                         const PageTask& task = plan.tasks[i];
                         PageExpander(file_.header(), file_.header().layers[task.layer], columns,
                                      codebooks, kernels_.expand, scratch.expand)
                             .run(plan.spans[task.span], static_cast<size_t>(task.first), out);
                       });
}

Status PageDecoder::probe(const Plan& plan, LostPages* lost) {
  PageWants wants;
  wants.sh_detail = plan.detail == L4D_DETAIL_FULL;
  return for_each_page({plan, 0, plan.tasks.size(), wants, lost}, nullptr,
                       [](size_t, const PageColumns&, const PageCodebooks&, PageScratch&) {});
}

Status PageDecoder::prove(const Plan& plan, size_t task, bool with_detail, LostPages* lost) {
  PageWants wants;
  wants.sh_detail = with_detail;
  MemoryCharge charge(file_.memory());
  L4D_RETURN_IF_ERROR(
      charge.take(plan.tasks[task].record.num_gaussians * RuleRows::kBytesPerGaussian, "a page"));
  Pages page{plan, task, task + 1, wants, lost};
  page.check_rules = true;
  return for_each_page(page, nullptr,
                       [](size_t, const PageColumns&, const PageCodebooks&, PageScratch&) {});
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
    L4D_RETURN_IF_ERROR(
        for_each_page({plan, i, i + 1, none, nullptr, false, &raw}, nullptr,
                      [](size_t, const PageColumns&, const PageCodebooks&, PageScratch&) {}));
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
