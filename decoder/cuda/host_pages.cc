// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/host_pages.h"

#include <algorithm>
#include <memory>

#include "decoder/read/page_reads.h"
#include "l4d/attributes.hpp"
#include "l4d/experimental/packed.h"

namespace l4d::cuda {

void HostPages::find(const Plan& plan) {
  runs_.clear();
  escapes_.clear();
  expanded_ = {};
  packed_ = {};
  bytes_ = 0;
  for (size_t t = 0; t < plan.tasks.size(); ++t) {
    const PageTask& task = plan.tasks[t];
    if (is_rans_page(task.record)) continue;  // the device decodes those
    if (runs_.empty() || runs_.back().end_task != t || runs_.back().layer != task.layer) {
      HostRun run;
      run.first = task.first;
      run.layer = task.layer;
      run.first_task = t;
      runs_.push_back(run);
    }
    runs_.back().count += task.record.num_gaussians;
    runs_.back().end_task = t + 1;
  }
}

Status HostPages::expand(const Plan& plan, uint32_t attributes, MemoryCharge* charge) {
  if (runs_.empty()) return {};
  const uint64_t n = plan.num_gaussians;
  const uint32_t degree = file_.header().sh_degree;
  uint64_t numbers = 0;
  for_each_decoded(
      [&](const AttributeInfo& a, const float*) {
        if ((attributes & a.flag) != 0) numbers += a.numbers(degree);
      },
      expanded_);
  const bool windows = (attributes & L4D_CUDA_MEAN_T) != 0 && file_.header().has_windows();
  if (windows) numbers += 2;  // as wide as floats
  const uint64_t bytes = n * numbers * sizeof(float);
  L4D_RETURN_IF_ERROR(charge->take(bytes, "pages that the host decodes"));
  L4D_RETURN_IF_ERROR(expanded_memory_.reserve(static_cast<size_t>(bytes)));
  float* next = expanded_memory_.as<float>();
  for_each_decoded(
      [&](const AttributeInfo& a, float*& array) {
        if ((attributes & a.flag) == 0) return;
        array = next;
        next += n * a.numbers(degree);
      },
      expanded_);
  if (windows) expanded_.window = reinterpret_cast<uint32_t*>(next);
  expanded_.capacity = n;
  PageDecoder pages(file_, decode_kernels_simd(), threads_);
  uint64_t rows = 0;
  // Tasks lie in the order of the arrays, so that a run of rows is a run of tasks.
  for (const HostRun& run : runs_) {
    L4D_RETURN_IF_ERROR(
        pages.expand(plan, run.first_task, run.end_task, expanded_, nullptr, nullptr));
    rows += run.count;
  }
  bytes_ = std::max(bytes_, rows * numbers * sizeof(float));
  return {};
}

Status HostPages::pack(const Plan& plan, uint32_t attributes, MemoryCharge* charge) {
  if (runs_.empty()) return {};
  const SceneHeader& header = file_.header();
  const uint64_t n = plan.num_gaussians;
  const auto wanted = [&](uint32_t attribute) { return (attributes & attribute) != 0; };
  struct Column {
    bool wanted;
    uint64_t numbers;
    uint16_t** array;
  };
  std::vector<Column> columns = {{wanted(L4D_CUDA_POSITION), 3, &packed_.position},
                                 {wanted(L4D_CUDA_MEAN_T), 1, &packed_.mean_t},
                                 {wanted(L4D_CUDA_OPACITY), 1, &packed_.opacity},
                                 {wanted(L4D_CUDA_LOG_SCALE), 1, &packed_.scale_factor}};
  uint64_t row_bytes = 0;
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    size_t stages = 0;
    for (const HostRun& run : runs_) {
      stages = std::max(stages, header.component(header.layers[run.layer], c).stages.size());
    }
    columns.push_back({wanted(component_attribute(c)), stages, &packed_.component[c].index});
    row_bytes += wanted(component_attribute(c)) ? sizeof(uint8_t) : 0;  // depths
  }
  for (const Column& c : columns) row_bytes += c.wanted ? c.numbers * sizeof(uint16_t) : 0;
  const bool windows = wanted(L4D_CUDA_MEAN_T) && header.has_windows();
  if (windows) row_bytes += 2 * sizeof(uint32_t);
  L4D_RETURN_IF_ERROR(charge->take(n * row_bytes, "pages that the host decodes"));
  L4D_RETURN_IF_ERROR(packed_memory_.reserve(static_cast<size_t>(n * row_bytes)));
  if (windows) packed_.window = packed_memory_.as<uint32_t>();
  uint16_t* next = packed_memory_.as<uint16_t>() + (windows ? 4 * n : 0);
  for (const Column& c : columns) {
    if (!c.wanted) continue;
    *c.array = next;
    next += n * c.numbers;
  }
  uint8_t* depths = reinterpret_cast<uint8_t*>(next);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (!wanted(component_attribute(c))) continue;
    packed_.component[c].depth = depths;
    depths += n;
  }
  packed_.capacity = n;
  uint64_t rows = 0;
  for (HostRun& run : runs_) {
    L4D_RETURN_IF_ERROR(pack_run(plan, &run, charge));
    rows += run.count;
  }
  bytes_ = std::max(bytes_, rows * row_bytes);
  return {};
}

// How many escapes there are is known when they are decoded.
Status HostPages::pack_run(const Plan& plan, HostRun* run, MemoryCharge* charge) {
  const SceneHeader& header = file_.header();
  const LayerHeader& layer = header.layers[run->layer];
  Plan part;
  part.tasks.assign(plan.tasks.begin() + static_cast<std::ptrdiff_t>(run->first_task),
                    plan.tasks.begin() + static_cast<std::ptrdiff_t>(run->end_task));
  part.detail = plan.detail;
  part.sh_bytes = plan.sh_bytes;
  MemoryCharge charge_for_room(file_.memory());
  l4d_packed_buffers out = packed_;
  std::array<std::unique_ptr<uint16_t[]>, L4D_COMPONENT_COUNT> room;
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    l4d_packed_component& to = out.component[c];
    if (to.depth == nullptr || !header.component(layer, c).escapes) continue;
    const uint64_t numbers = run->count * header.component_dim(layer, c);
    L4D_RETURN_IF_ERROR(charge_for_room.take(numbers * sizeof(uint16_t), "escapes"));
    // Not filled with zeros: most of it is never touched.
    room[c].reset(new uint16_t[static_cast<size_t>(numbers)]);
    to.escape = room[c].get();
    to.escape_capacity = run->count;
  }
  PageDecoder pages(file_, decode_kernels_simd(), threads_);
  L4D_RETURN_IF_ERROR(pages.pack(part, out, nullptr, nullptr));
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const uint64_t numbers = out.component[c].num_escapes * header.component_dim(layer, c);
    run->escape_rows[c] = out.component[c].num_escapes;
    run->escape_at[c] = escapes_.size();
    if (numbers == 0) continue;
    L4D_RETURN_IF_ERROR(charge->take(numbers * sizeof(uint16_t), "escapes"));
    escapes_.insert(escapes_.end(), room[c].get(), room[c].get() + numbers);
  }
  return {};
}

}  // namespace l4d::cuda
