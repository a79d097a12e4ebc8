// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/bucket_cache.h"

#include <numeric>
#include <utility>

#include "l4d/attributes.hpp"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

constexpr size_t kPrepareGrain = 4096;

// A page that is lost altogether counts for both of its parts.
size_t count_chunks(const LostPages& lost) {
  size_t parts = 0;
  for (const LostPage& page : lost) parts += page.detail_only ? 1 : 2;
  return parts;
}

// Range `span` of a plan alone: its arrays begin at 0.
Plan part_of(const Plan& plan, size_t span, size_t first_task, size_t end_task) {
  Plan part;
  part.detail = plan.detail;
  part.sh_bytes = plan.sh_bytes;
  part.spans.push_back(plan.spans[span]);
  for (size_t t = first_task; t < end_task; ++t) {
    part.tasks.push_back(plan.tasks[t]);
    part.tasks.back().span = 0;
    part.tasks.back().first -= plan.spans[span].first;
  }
  return part;
}

}  // namespace

void BucketCache::evict(uint64_t needed) {
  // The cache gives way to its own budget and to the limit on all memory.
  const auto fits = [&] {
    return bytes_ + needed <= stream_.options().cache_bytes &&
           stream_.file().memory().has_capacity(needed);
  };
  // What the query at hand wants is the newest.
  while (oldest_ != nullptr && oldest_->last_use != clock_ && !fits()) {
    const PreparedBucket& bucket = oldest_->bucket;
    drop(entries_.find(Key(bucket.layer, bucket.bucket, oldest_->detail)));
  }
}

void BucketCache::use(CachedBucket* entry) {
  entry->last_use = clock_;
  if (newest_ == entry) return;
  unlink(entry);
  entry->older = newest_;
  if (newest_ != nullptr) newest_->newer = entry;
  newest_ = entry;
  if (oldest_ == nullptr) oldest_ = entry;
}

void BucketCache::unlink(CachedBucket* entry) {
  if (entry->newer != nullptr) entry->newer->older = entry->older;
  if (entry->older != nullptr) entry->older->newer = entry->newer;
  if (newest_ == entry) newest_ = entry->older;
  if (oldest_ == entry) oldest_ = entry->newer;
  entry->newer = entry->older = nullptr;
}

void BucketCache::drop(Entries::iterator entry) {
  unlink(&entry->second);
  bytes_ -= entry->second.memory_bytes;
  stream_.file().memory().release(entry->second.memory_bytes);
  entries_.erase(entry);
}

void BucketCache::clear() {
  entries_.clear();
  newest_ = oldest_ = nullptr;
  if (stream_.is_open()) stream_.file().memory().release(bytes_);
  bytes_ = 0;
}

void BucketCache::close() {
  clear();
  buckets_decoded_ = 0;
  hits_ = 0;
}

Status BucketCache::decode(const Plan& plan, size_t span, size_t first_task, size_t end_task,
                           CachedBucket* entry) {
  PreparedBucket* const out = &entry->bucket;
  out->layer = plan.spans[span].layer;
  out->bucket = plan.spans[span].bucket;
  const SceneHeader& header = stream_.file().header();
  const l4d_bucket_span& r = plan.spans[span];
  const LayerHeader& layer = header.layers[r.layer];
  size_t n = static_cast<size_t>(r.count);
  out->permanent = layer.permanent;
  out->flat = layer.flat();
  out->center = r.center;
  out->position.resize(3 * n);
  out->mean.resize(n);
  out->opacity.resize(n);
  out->sh.resize(header.sh_dim() * n);
  MemoryCharge scratch(stream_.file().memory());
  const size_t numbers = layer.flat() ? 14 : 12;
  L4D_RETURN_IF_ERROR(scratch.take(uint64_t{n} * numbers * sizeof(float), "a bucket"));
  std::vector<float> log_scale(4 * n), rotor(8 * n);
  std::vector<uint32_t> windows(layer.flat() ? 2 * n : 0);
  l4d_gaussian_buffers buffers{};
  buffers.struct_size = sizeof buffers;
  buffers.position = out->position.data();
  buffers.mean_t_local = out->mean.data();
  buffers.opacity = out->opacity.data();
  buffers.sh = out->sh.data();
  buffers.log_scale = log_scale.data();
  buffers.rotor = rotor.data();
  buffers.window = layer.flat() ? windows.data() : nullptr;
  Plan part = part_of(plan, span, first_task, end_task);
  LostPages lost;
  L4D_RETURN_IF_ERROR(stream_.pages().expand(
      part, 0, part.tasks.size(), buffers, stream_.progress("decode"), stream_.if_tolerant(&lost)));
  if (!lost.empty()) {
    stream_.losses().add_pages(part, lost);
    entry->missing.detail = part.detail;
    entry->missing.sh_bytes = part.sh_bytes;
    entry->missing.spans = part.spans;
    entry->lost_chunks = count_chunks(lost);
    for (const LostPage& page : lost) entry->missing.tasks.push_back(part.tasks[page.task]);
    const std::vector<RowMove> moves = remove_lost(lost, &part);
    n = static_cast<size_t>(part.num_gaussians);
    for_each_decoded([&](const AttributeInfo& a,
                         float* rows) { move_rows(moves, a.numbers(header.sh_degree), rows); },
                     buffers);
    move_rows(moves, 2, buffers.window);
    // All pages of the bucket are in the plan.
    out->index.resize(static_cast<size_t>(r.count));
    std::iota(out->index.begin(), out->index.end(), 0u);
    move_rows(moves, 1, out->index.data());
    out->index.resize(n);
  }
  out->count = n;
  out->reference.resize(n);
  out->covariance.resize(6 * n);
  if (entry->with_shape) {
    out->scale.resize(3 * n);
    out->rotation.resize(4 * n);
  }
  if (out->fades()) out->lambda.resize(n);
  out->window.resize(out->flat ? n : 0);
  for (size_t i = 0; i < out->window.size(); ++i) {
    out->window[i] = {windows[2 * i], windows[2 * i + 1]};
  }
  if (layer.component[L4D_COMPONENT_ROTOR_TEMPORAL].coding != ComponentCodingId::kZero) {
    out->velocity.resize(3 * n);
  }
  parallel_for(stream_.threads(), n, kPrepareGrain, [&](size_t begin, size_t end) {
    out->prepare(header, rotor.data(), log_scale.data(), begin, end);
  });
  out->finish(header.timeline, header.sh_dim());
  ++buckets_decoded_;
  return {};
}

Status BucketCache::has_recovered(const CachedBucket& entry, bool* recovered) {
  *recovered = false;
  if (entry.missing.tasks.empty()) return {};
  LostPages lost;
  L4D_RETURN_IF_ERROR(stream_.pages().probe(entry.missing, &lost));
  *recovered = count_chunks(lost) < entry.lost_chunks;
  if (!*recovered) stream_.losses().add_pages(entry.missing, lost);
  return {};
}

BucketCache::Key BucketCache::key_of(const l4d_bucket_span& span, uint32_t detail) {
  return Key(span.layer, span.bucket, detail);
}

bool BucketCache::holds(const l4d_bucket_span& span, uint32_t detail, bool with_shape) const {
  const auto it = entries_.find(key_of(span, detail));
  return it != entries_.end() && (it->second.with_shape || !with_shape);
}

Status BucketCache::load(const Plan& plan, bool with_shape, std::vector<CachedBucket*>* out) {
  out->clear();
  ++clock_;
  for (const l4d_bucket_span& r : plan.spans) {
    const auto it = entries_.find(key_of(r, plan.detail));
    if (it != entries_.end()) use(&it->second);
  }
  MemoryBudget& memory = stream_.file().memory();
  size_t task = 0;
  for (size_t i = 0; i < plan.spans.size(); ++i) {
    const l4d_bucket_span& r = plan.spans[i];
    const size_t first_task = task;
    while (task < plan.tasks.size() && plan.tasks[task].span == i) ++task;
    const Key key = key_of(r, plan.detail);
    const auto it = entries_.find(key);
    if (it != entries_.end()) {
      bool stale = with_shape && !it->second.with_shape;
      if (!stale) L4D_RETURN_IF_ERROR(has_recovered(it->second, &stale));
      if (!stale) {
        ++hits_;
        out->push_back(&it->second);
        continue;
      }
      drop(it);
    }
    CachedBucket entry;
    entry.with_shape = with_shape;
    const SceneHeader& header = stream_.file().header();
    entry.memory_bytes = PreparedBucket::memory_bytes(static_cast<size_t>(r.count), header.sh_dim(),
                                                      header.layers[r.layer].flat(), with_shape);
    entry.detail = plan.detail;
    // Decoding a bucket takes scratch of less than its own size beside it.
    evict(2 * entry.memory_bytes);
    MemoryCharge charge(memory);
    L4D_RETURN_IF_ERROR(charge.take(entry.memory_bytes, "the bucket cache"));
    L4D_RETURN_IF_ERROR(decode(plan, i, first_task, task, &entry));
    entry.number = ++numbered_;
    const uint64_t memory_bytes = entry.memory_bytes;
    CachedBucket* const kept = &(entries_[key] = std::move(entry));
    use(kept);
    charge.keep();
    // Who has come to want the details is not likely to go back.
    const auto base = entries_.find({r.layer, r.bucket, L4D_DETAIL_BASE_COLOR});
    if (plan.detail == L4D_DETAIL_FULL && base != entries_.end()) drop(base);
    bytes_ += memory_bytes;
    out->push_back(kept);
  }
  return {};
}

}  // namespace l4d
