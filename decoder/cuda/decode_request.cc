// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/decode_request.h"

#include <utility>

#include "libl4dcodec/base/checked.h"
#include "libl4dcodec/scene/window.h"

namespace l4d::cuda {
namespace {

// Columns of a page begin where those of a warp do.
constexpr uint32_t kSlotAlignment = 32;

}  // namespace

Status DecodeRequest::make(SceneFile& file, LayerTables& tables, Plan plan,
                           const LayerTables::Wants& wants, bool with_detail) {
  *this = DecodeRequest();
  plan_ = std::move(plan);
  const SceneHeader& header = file.header();
  for (size_t t = 0; t < plan_.tasks.size(); ++t) {
    const PageTask& task = plan_.tasks[t];
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      may_have_escapes_ |= header.component(header.layers[task.layer], c).escapes;
    }
    if (!is_rans_page(task.record)) continue;
    L4D_RETURN_IF_ERROR(tables.load(task.layer, wants));
    L4D_RETURN_IF_ERROR(add_page(file, wants, t, with_detail));
  }
  reads_.finish(max_read_gap(file.source(), plan_, with_detail));
  if (num_states_ > UINT32_MAX) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, "the query selects more Gaussians than one decode takes");
  }
  return {};
}

Status DecodeRequest::add_page(SceneFile& file, const LayerTables::Wants& wants, size_t task_index,
                               bool with_detail) {
  const SceneHeader& header = file.header();
  const PageTask& task = plan_.tasks[task_index];
  const PageRecord& record = task.record;
  const EntropyTables* entropy = nullptr;
  L4D_RETURN_IF_ERROR(file.codebooks().entropy_tables(task.layer, &entropy));
  const bool detail = record.has_sh_detail() && with_detail;
  const bool whole = detail || !record.has_sh_detail();
  const l4d_bucket_span& span = plan_.spans[task.span];
  DevicePage page{};
  page.first = task.first;
  page.center = span.center;
  page.width = static_cast<float>(span.width);
  page.slot = static_cast<uint32_t>(num_slots_);
  page.state = static_cast<uint32_t>(num_states_);
  page.n = record.num_gaussians;
  page.layer = task.layer;
  page.chunk_bytes[0] = record.chunk.stored_bytes;
  page.chunk_bytes[1] = detail ? record.sh_detail.stored_bytes : 0;
  page.middle =
      static_cast<uint32_t>(record.has_sh_detail() ? first_detail_channel(header, entropy->channels)
                                                   : entropy->channels.size());
  page.sh_limit = whole ? kMaxCoefficients : header.sh_base;
  page.has_sh = whole || header.sh_base > 0;
  const LayerHeader& layer = header.layers[task.layer];
  if (layer.flat()) {
    has_windows_ = true;
    page.window_base = window_base(record.bucket, layer.level, header.timeline.num_frames);
  }
  L4D_RETURN_IF_ERROR(add_codebooks(file, wants, task, &page));
  const uint32_t index = static_cast<uint32_t>(pages_.size());
  reads_.add(record, index, with_detail);
  for (uint32_t first = 0; first < page.n; first += kExpandGaussians) {
    expands_.push_back({index, first});
  }
  pages_.push_back(page);
  page_tasks_.push_back(task_index);
  num_slots_ += align_up(page.n, kSlotAlignment);
  num_states_ += align_up(page.n, kSlotAlignment) + kStatesBehind;
  return {};
}

Status DecodeRequest::add_codebooks(SceneFile& file, const LayerTables::Wants& wants,
                                    const PageTask& task, DevicePage* page) {
  const SceneHeader& header = file.header();
  const LayerHeader& layer = header.layers[task.layer];
  const BlockRecord* const block = task.block();
  page_codebooks_.emplace_back();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    CodebookIndex& index = page_codebooks_.back()[c];
    index = kLayerCodebook;
    page->stage0_entries[c] = stage0_entries(header, layer, c, block);
    if (!wants[c] || block == nullptr || block->tables[c].num_entries == 0) continue;
    const BlockKey key{task.layer, task.directory_index, task.record.block, c};
    const auto known = codebook_of_.find(key);
    if (known != codebook_of_.end()) {
      index = known->second;
      continue;
    }
    const CodebookData* codebook = nullptr;
    L4D_RETURN_IF_ERROR(
        file.codebooks().block_codebook(task.block_id(), c, block->tables[c], &codebook));
    index = codebook_of_[key] = static_cast<CodebookIndex>(codebooks_.size());
    codebooks_.push_back(codebook);
  }
  return {};
}

void DecodeRequest::number_pieces(const HostPages& host) {
  size_t page = 0;
  const auto number_until = [&](size_t task) {
    for (; page < pages_.size() && page_tasks_[page] < task; ++page) {
      pages_[page].piece = num_pieces_;
      num_pieces_ += (pages_[page].n + kExpandGaussians - 1) / kExpandGaussians;
    }
  };
  for (const HostRun& run : host.runs()) {
    number_until(run.first_task);
    host_pieces_.push_back(num_pieces_++);
  }
  number_until(plan_.tasks.size());
}

}  // namespace l4d::cuda
