// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/decoder.h"

#include <algorithm>

#include "decoder/read/query_reads.h"
#include "l4d/attributes.hpp"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

constexpr uint64_t kDefaultMemory = uint64_t{16} << 30;
constexpr uint64_t kDefaultGaussians = uint64_t{1} << 30;
constexpr uint64_t kDefaultCache = uint64_t{512} << 20;

template <typename T>
void replace_zero(T& value, T by) {
  if (value == 0) value = by;
}

}  // namespace

Decoder::Decoder(const l4d_decoder_options& options) : options_(options) {
  replace_zero(options_.max_memory_bytes, kDefaultMemory);
  replace_zero(options_.max_gaussians, kDefaultGaussians);
  replace_zero(options_.max_frames, kMaxFrames);
  replace_zero(options_.cache_bytes, kDefaultCache);
  const bool reference = options_.backend == L4D_BACKEND_REFERENCE;
  kernels_ = reference ? decode_kernels_reference() : decode_kernels_simd();
  set_progress(options_.progress, options_.progress_user);
}

void Decoder::close() {
  drop_cache();
  buckets_decoded_ = 0;
  cache_hits_ = 0;
  losses_ = Losses();
  pages_.reset();
  file_.reset();
  own_file_.reset();
}

Status Decoder::open(ByteSource source) {
  close();
  return start(std::move(source));
}

// A stream is open when both parts of it are there: neither stays alone where memory runs out.
Status Decoder::start(ByteSource source) {
  auto file = std::make_unique<SceneFile>(std::move(source), options_, *kernels_.stream);
  L4D_RETURN_IF_ERROR(file->open());
  pages_ = std::make_unique<PageDecoder>(*file, kernels_, static_cast<int>(options_.threads));
  file_ = std::move(file);
  return {};
}

Status Decoder::open_file(const char* path) {
  close();
  auto reader = std::make_unique<FileReader>();
  L4D_RETURN_IF_ERROR(reader->open(path));
  ByteSource source;
  L4D_RETURN_IF_ERROR(ByteSource::from_reader(reader->reader(), &source));
  L4D_RETURN_IF_ERROR(start(std::move(source)));
  own_file_ = std::move(reader);
  return {};
}

PageDecoder::Progress Decoder::progress(const char* stage) const {
  if (progress_ == nullptr) return nullptr;
  return [this, stage](uint64_t done, uint64_t total) {
    return progress_(progress_user_, done, total, stage) == 0;
  };
}

Status Decoder::begin_query(const l4d_query& query, Plan* plan) {
  losses_.begin_query();
  file_->begin_query();
  return make_plan(*file_, query, losses_if_tolerant(), plan);
}

Status Decoder::select(const l4d_query& query, l4d_selection* out) {
  Plan plan;
  L4D_RETURN_IF_ERROR(begin_query(query, &plan));
  out->num_gaussians = plan.num_gaussians;
  out->num_ranges = plan.ranges.size();
  out->num_chunks = plan.tasks.size();
  out->bytes = plan.bytes;
  out->sh_bytes = plan.sh_bytes;
  out->directory_bytes = plan.directory_bytes;
  return {};
}

Status Decoder::ranges(const l4d_query& query, l4d_range* out, uint64_t capacity, uint64_t* count) {
  Plan plan;
  L4D_RETURN_IF_ERROR(begin_query(query, &plan));
  std::copy_n(plan.ranges.begin(), std::min<uint64_t>(capacity, plan.ranges.size()), out);
  *count = plan.ranges.size();
  return {};
}

Status Decoder::reads(const l4d_query& query, uint32_t step, l4d_byte_range* out, uint64_t capacity,
                      uint64_t* count) {
  losses_.begin_query();
  file_->begin_query();
  std::vector<l4d_byte_range> ranges;
  L4D_RETURN_IF_ERROR(find_query_reads(*file_, query, step, losses_if_tolerant(), &ranges));
  std::copy_n(ranges.begin(), std::min<uint64_t>(capacity, ranges.size()), out);
  *count = ranges.size();
  return {};
}

namespace {

template <typename Buffers>
Status check_capacity(const Plan& plan, Buffers* out) {
  out->count = plan.num_gaussians;
  if (out->ranges != nullptr) out->num_ranges = plan.ranges.size();
  if (plan.num_gaussians > out->capacity) {
    return Status(L4D_ERR_BUFFER_TOO_SMALL, "capacity is " + std::to_string(out->capacity) +
                                                ", the query selects " +
                                                std::to_string(plan.num_gaussians) + " Gaussians");
  }
  if (out->ranges != nullptr && plan.ranges.size() > out->range_capacity) {
    return Status(L4D_ERR_BUFFER_TOO_SMALL,
                  "range_capacity is " + std::to_string(out->range_capacity) +
                      ", the query selects " + std::to_string(plan.ranges.size()));
  }
  return {};
}

template <typename Buffers>
void describe_output(const Plan& plan, Buffers* out) {
  if (out->ranges != nullptr) {
    std::copy(plan.ranges.begin(), plan.ranges.end(), out->ranges);
    out->num_ranges = plan.ranges.size();
  }
  out->count = plan.num_gaussians;
}

}  // namespace

Status Decoder::decode(const l4d_query& query, l4d_gaussian_buffers* out) {
  Plan plan;
  L4D_RETURN_IF_ERROR(begin_query(query, &plan));
  L4D_RETURN_IF_ERROR(check_capacity(plan, out));
  LostPages lost;
  L4D_RETURN_IF_ERROR(pages_->expand(plan, 0, plan.tasks.size(), *out, progress("decode"),
                                     losses_if_tolerant() == nullptr ? nullptr : &lost));
  if (!lost.empty()) {
    losses_.add_pages(plan, lost);
    const std::vector<RowMove> moves = remove_lost(lost, &plan);
    const uint32_t degree = file_->header().sh_degree;
    for_each_decoded(
        [&](const AttributeInfo& a, float* rows) { move_rows(moves, a.numbers(degree), rows); },
        *out);
    move_rows(moves, 1, out->mean_t_double);
  }
  describe_output(plan, out);
  buckets_decoded_ += plan.ranges.size();
  return {};
}

Status Decoder::decode_packed(const l4d_query& query, l4d_packed_buffers* out) {
  Plan plan;
  L4D_RETURN_IF_ERROR(begin_query(query, &plan));
  L4D_RETURN_IF_ERROR(check_capacity(plan, out));
  LostPages lost;
  L4D_RETURN_IF_ERROR(pages_->pack(plan, *out, progress("decode"),
                                   losses_if_tolerant() == nullptr ? nullptr : &lost));
  if (!lost.empty()) {
    losses_.add_pages(plan, lost);
    size_t stages[L4D_COMPONENT_COUNT] = {};
    for (const l4d_range& r : plan.ranges) {
      const SceneHeader& header = file_->header();
      for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
        stages[c] = std::max(stages[c], header.component(header.layers[r.layer], c).stages.size());
      }
    }
    const std::vector<RowMove> moves = remove_lost(lost, &plan);
    move_rows(moves, 3, out->position);
    move_rows(moves, 1, out->mean_t);
    move_rows(moves, 1, out->opacity);
    move_rows(moves, 1, out->scale_factor);
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      const l4d_packed_component& to = out->component[c];
      move_rows(moves, 1, to.depth);
      for (size_t s = 0; to.index != nullptr && s < stages[c]; ++s) {
        move_rows(moves, 1, to.index + s * static_cast<size_t>(out->capacity));
      }
    }
  }
  describe_output(plan, out);
  buckets_decoded_ += plan.ranges.size();
  return {};
}

void Decoder::counters(l4d_counters* out) const {
  out->reads = file_->source().reads();
  out->bytes_read = file_->source().bytes_read();
  out->pages_decoded = pages_->pages_decoded();
  out->buckets_decoded = buckets_decoded_;
  out->cache_hits = cache_hits_;
  out->memory_bytes = file_->memory().used();
  out->peak_memory_bytes = file_->memory().peak();
  out->pages_lost = losses_.pages();
  out->buckets_lost = losses_.buckets();
  out->gaussians_lost = losses_.gaussians();
  out->details_lost = losses_.details();
}

}  // namespace l4d
