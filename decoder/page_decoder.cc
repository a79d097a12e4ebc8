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
// Gaussians reconstructed at a time: the rows between two steps stay in the first-level cache.
constexpr size_t kRowBlock = 256;

// Pages of a batch and where their bytes lie.
struct Batch {
  size_t begin = 0;
  size_t end = 0;
  std::vector<Bytes> buffers;
  std::vector<ByteSpan> pages;
};

Status read_batch(ByteSource& source, const Plan& plan, Batch* batch) {
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
    L4D_RETURN_IF_ERROR(source.read(first.offset, end - first.offset, batch->buffers.back(), &run));
    for (; i < j; ++i) {
      const ChunkRef& c = plan.tasks[i].record.chunk;
      batch->pages.push_back(
          run.subspan(static_cast<size_t>(c.offset - first.offset), c.stored_bytes));
    }
  }
  return {};
}

}  // namespace

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
  s->stream.kernels = &stream_;
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
    const size_t stages = header.component(layer, c).stages.size();
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
                               PageScratch& scratch, SectionBytes* sections) {
  const ChunkRef& chunk = task.record.chunk;
  if (hash64(bytes) != chunk.hash) {
    return Status(L4D_ERR_CHECKSUM, "CHNK-2", chunk.offset, "checksum of a page does not match");
  }
  ByteSpan raw;
  L4D_RETURN_IF_ERROR(decode_chunk(scratch.stream, chunk.codec, bytes, chunk.raw_bytes, chunk.offset,
                                   scratch.storage, &raw));
  const SceneHeader& header = file_.header();
  return decode_page(scratch.stream, raw, chunk.offset, header, header.layers[task.layer],
                     block_of(task), task.record.num_gaussians, wants, &scratch.columns, sections);
}

Status PageDecoder::for_each_page(const Plan& plan, size_t begin, size_t end,
                                  const PageWants& wants, bool need_books, SectionBytes* sections,
                                  const PageBody& body, const Progress& progress) {
  Batch batch;
  batch.end = begin;
  uint64_t done = 0;
  while (batch.end < end) {
    batch.begin = batch.end;
    uint64_t bytes = 0;
    while (batch.end < end && (batch.end == batch.begin || bytes < kBatchBytes)) {
      bytes += uint64_t{plan.tasks[batch.end].record.chunk.stored_bytes} +
               plan.tasks[batch.end].record.chunk.raw_bytes;
      ++batch.end;
    }
    L4D_RETURN_IF_ERROR(file_.memory().charge(bytes, "a batch of pages"));
    const auto run = [&]() -> Status {
      L4D_RETURN_IF_ERROR(read_batch(file_.source(), plan, &batch));
      std::vector<PageBooks> books(batch.end - batch.begin);
      blocks_.clear();
      for (size_t i = batch.begin; i < batch.end; ++i) {
        const PageTask& task = plan.tasks[i];
        if (task.record.block != kNoBlock) {
          std::vector<const DirectoryPage*> pages;
          L4D_RETURN_IF_ERROR(file_.directory_pages(task.layer, task.directory_index,
                                                    task.directory_index, &pages));
          blocks_[{{task.layer, task.directory_index}, task.record.block}] =
              pages[0]->blocks[task.record.block];
        }
        if (need_books) L4D_RETURN_IF_ERROR(resolve_books(task, wants, &books[i - batch.begin]));
      }
      std::vector<Status> status(batch.end - batch.begin);
      std::mutex sections_mutex;
      parallel_for(threads_, batch.end - batch.begin, 1, [&](size_t first, size_t last) {
        auto scratch = take_scratch();
        for (size_t i = first; i < last; ++i) {
          SectionBytes page_sections{};
          status[i] = parse_page(plan.tasks[batch.begin + i], batch.pages[i], wants, *scratch,
                                 sections == nullptr ? nullptr : &page_sections);
          if (!status[i].ok()) continue;
          if (sections != nullptr) {
            std::lock_guard<std::mutex> lock(sections_mutex);
            for (size_t s = 0; s < page_sections.size(); ++s) (*sections)[s] += page_sections[s];
          }
          body(batch.begin + i, scratch->columns, books[i], *scratch);
        }
        give_scratch(std::move(scratch));
      });
      for (Status& s : status) {
        if (!s.ok()) return std::move(s);
      }
      return {};
    };
    const Status status = run();
    file_.memory().release(bytes);
    if (!status.ok()) return status;
    done += batch.end - batch.begin;
    pages_decoded_ += batch.end - batch.begin;
    if (progress && !progress(done, end - begin)) {
      return Status(L4D_ERR_CANCELLED, "cancelled by the progress callback");
    }
  }
  return {};
}

namespace {

VqSource vq_source(const ComponentCoding& coding, unsigned dim, const ComponentColumns& columns,
                   const std::array<const CodebookData*, L4D_MAX_STAGES>& books) {
  VqSource source;
  source.dim = dim;
  source.num_stages = coding.stages.size();
  for (size_t s = 0; s < source.num_stages; ++s) {
    source.book[s] = books[s]->entries.data();
    source.index[s] = columns.index[s].data();
  }
  if (coding.has_depth()) source.depth = columns.depth.data();
  source.literal = columns.literal.data();
  return source;
}

// One component of a page, block by block of rows.
class ComponentRows {
 public:
  ComponentRows(const ReconstructKernels& kernels, const ComponentCoding& coding, unsigned dim,
                const ComponentColumns& columns, const PageBooks& books, unsigned c)
      : kernels_(kernels), coding_(coding.coding), dim_(dim), raw_(columns.raw.data()) {
    if (coding.vq()) source_ = vq_source(coding, dim, columns, books.book[c]);
  }
  void rows(size_t begin, size_t end, float* dst) {
    switch (coding_) {
      case ComponentCodingId::kZero:
        std::fill(dst, dst + (end - begin) * dim_, 0.0f);
        break;
      case ComponentCodingId::kRaw32:
        std::copy(raw_ + begin * dim_, raw_ + end * dim_, dst);
        break;
      case ComponentCodingId::kVq:
        kernels_.vq_rows(source_, cursor_, begin, end, dst);
        break;
    }
  }

 private:
  const ReconstructKernels& kernels_;
  ComponentCodingId coding_;
  unsigned dim_;
  const float* raw_;
  VqSource source_;
  VqCursor cursor_;
};

void expand_scalar(const ReconstructKernels& kernels, const ScalarCoding& coding,
                   const std::vector<uint16_t>& codes, const std::vector<float>& raw, size_t n,
                   float* dst) {
  switch (coding.coding) {
    case ScalarCodingId::kConstant:
      std::fill(dst, dst + n, coding.offset);
      break;
    case ScalarCodingId::kRaw32:
      std::copy(raw.begin(), raw.begin() + static_cast<std::ptrdiff_t>(n), dst);
      break;
    case ScalarCodingId::kSq:
      kernels.scalars(codes.data(), n, coding.offset, coding.step, dst);
      break;
  }
}

}  // namespace

void PageDecoder::expand_page(const PageTask& task, const l4d_range& range,
                              const PageColumns& columns, const PageBooks& books,
                              PageScratch& scratch, const l4d_gaussian_buffers& out) {
  const SceneHeader& header = file_.header();
  const LayerHeader& layer = header.layers[task.layer];
  const size_t n = columns.n;
  const size_t first = static_cast<size_t>(task.first);
  if (out.position != nullptr) {
    float* dst = out.position + 3 * first;
    if (header.position == MeanCodingId::kF16) {
      const uint16_t* axes[3] = {columns.position[0].data(), columns.position[1].data(),
                                 columns.position[2].data()};
      reconstruct_.positions(axes, n, header.position_center, header.position_scale, dst);
    } else {
      for (size_t i = 0; i < n; ++i) {
        for (size_t k = 0; k < 3; ++k) dst[3 * i + k] = columns.raw_position[k][i];
      }
    }
  }
  if (out.mean_t != nullptr || out.mean_t_local != nullptr) {
    scratch.means.resize(n);
    float* local = out.mean_t_local != nullptr ? out.mean_t_local + first : scratch.means.data();
    if (layer.mean_t == MeanCodingId::kF16) {
      reconstruct_.means(columns.mean_t.data(), n, static_cast<float>(range.width), local);
    } else if (layer.mean_t == MeanCodingId::kRaw32) {
      for (size_t i = 0; i < n; ++i) {
        local[i] = static_cast<float>(static_cast<double>(columns.raw_mean_t[i]) - range.center);
      }
    } else {
      std::fill(local, local + n, 0.0f);
    }
    if (out.mean_t != nullptr) {
      float* dst = out.mean_t + first;
      if (layer.mean_t == MeanCodingId::kRaw32) {
        std::copy(columns.raw_mean_t.begin(),
                  columns.raw_mean_t.begin() + static_cast<std::ptrdiff_t>(n), dst);
      } else {
        for (size_t i = 0; i < n; ++i) {
          dst[i] = static_cast<float>(range.center + static_cast<double>(local[i]));
        }
      }
    }
  }
  if (out.opacity != nullptr) {
    expand_scalar(reconstruct_, header.opacity, columns.opacity, columns.raw_opacity, n,
                  out.opacity + first);
  }
  if (out.sh != nullptr) {
    const unsigned dim = header.sh_dim();
    ComponentRows sh(reconstruct_, header.sh, dim, columns.component[L4D_COMPONENT_SH], books,
                     L4D_COMPONENT_SH);
    sh.rows(0, n, out.sh + dim * first);
  }
  const auto component = [&](unsigned c) {
    return ComponentRows(reconstruct_, layer.component[c], header.component_dim(layer, c),
                         columns.component[c], books, c);
  };
  if (out.log_scale != nullptr) {
    ComponentRows scale = component(L4D_COMPONENT_SCALE);
    const unsigned dim = layer.scale_dim();
    scratch.rows_a.resize(4 * kRowBlock);
    scratch.factor.resize(n);
    expand_scalar(reconstruct_, layer.scale_factor, columns.scale_factor, columns.raw_scale_factor, n,
                  scratch.factor.data());
    const bool raw = layer.component[L4D_COMPONENT_SCALE].coding == ComponentCodingId::kRaw32;
    for (size_t begin = 0; begin < n; begin += kRowBlock) {
      const size_t count = std::min(kRowBlock, n - begin);
      float* dst = out.log_scale + 4 * (first + begin);
      float* rows = scratch.rows_a.data();
      scale.rows(begin, begin + count, rows);
      if (dim == 3) {  // spread three numbers to rows of four, from the back
        for (size_t i = count; i-- > 0;) {
          for (size_t k = 3; k-- > 0;) rows[4 * i + k] = rows[3 * i + k];
          rows[4 * i + 3] = 0.0f;
        }
      }
      if (raw) {
        std::copy(rows, rows + 4 * count, dst);
      } else {
        reconstruct_.log_scales(scratch.factor.data() + begin, rows, count, dst);
      }
      if (dim == 3) {
        for (size_t i = 0; i < count; ++i) dst[4 * i + 3] = layer.log_scale_t;
      }
    }
  }
  if (out.rotor != nullptr) {
    ComponentRows spatial = component(L4D_COMPONENT_ROTOR_SPATIAL);
    ComponentRows temporal = component(L4D_COMPONENT_ROTOR_TEMPORAL);
    scratch.rows_a.resize(4 * kRowBlock);
    scratch.rows_b.resize(4 * kRowBlock);
    for (size_t begin = 0; begin < n; begin += kRowBlock) {
      const size_t count = std::min(kRowBlock, n - begin);
      float* dst = out.rotor + 8 * (first + begin);
      spatial.rows(begin, begin + count, scratch.rows_a.data());
      temporal.rows(begin, begin + count, scratch.rows_b.data());
      if (SceneHeader::normalizes_rotor(layer)) {
        reconstruct_.rotors(scratch.rows_a.data(), scratch.rows_b.data(), count, dst);
      } else {
        for (size_t i = 0; i < count; ++i) {
          std::copy_n(scratch.rows_a.data() + 4 * i, 4, dst + 8 * i);
          std::copy_n(scratch.rows_b.data() + 4 * i, 4, dst + 8 * i + 4);
        }
      }
    }
  }
}

Status PageDecoder::expand(const Plan& plan, size_t begin, size_t end,
                           const l4d_gaussian_buffers& out, const Progress& progress) {
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
        expand_page(task, plan.ranges[task.range], columns, books, scratch, out);
      },
      progress);
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
        [](size_t, const PageColumns&, const PageBooks&, PageScratch&) {}, nullptr));
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
