// SPDX-License-Identifier: Apache-2.0
// 3D Gaussians at an instant, from cached buckets.
#include "libl4dcodec/scene/slice.h"

#include <algorithm>
#include <cmath>

#include "decoder/session/decoder.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

constexpr size_t kSliceGrain = 4096;

// The constant part of n Gaussians, from their decoded attributes.
void prepare_gaussians(const SceneHeader& header, const LayerHeader& layer, const float* rotor,
                       const float* log_scale, size_t begin, size_t end, PreparedBucket* out) {
  const double sequence_begin = header.timeline.time_begin;
  const double sequence_end = sequence_begin + sequence_duration(header.timeline);
  const float lo = static_cast<float>(sequence_begin - out->center);
  const float hi = static_cast<float>(sequence_end - out->center);
  for (size_t i = begin; i < end; ++i) {
    float scale[4];
    for (size_t k = 0; k < 4; ++k) scale[k] = std::exp(log_scale[4 * i + k]);
    const Slice4D<float> s = slice_gaussian(normalized_halves(rotor + 8 * i), scale);
    std::copy_n(s.covariance, 6, out->covariance.data() + 6 * i);
    if (!out->velocity.empty()) std::copy_n(s.velocity, 3, out->velocity.data() + 3 * i);
    if (!layer.permanent) out->lambda[i] = s.lambda;
    out->reference[i] =
        header.position_at_mean_time ? out->mean[i] : std::clamp(out->mean[i], lo, hi);
    if (header.opacity_logit) out->opacity[i] = 1.0f / (1.0f + std::exp(-out->opacity[i]));
  }
}

// Whether Gaussian i of a bucket has a finite covariance, and a finite position wherever the
// sequence takes it: from lo to hi, seconds from the centre. Its rotor can keep it from that, where
// it is stored as it is.
bool is_finite(const PreparedBucket& bucket, size_t i, float lo, float hi) {
  float sum = bucket.opacity[i] + bucket.reference[i];
  for (size_t k = 0; k < 6; ++k) sum += 0.0f * bucket.covariance[6 * i + k];
  if (!bucket.lambda.empty()) sum += 0.0f * bucket.lambda[i];
  for (size_t k = 0; k < 3; ++k) {
    const float at = bucket.position[3 * i + k];
    const float v = bucket.velocity.empty() ? 0.0f : bucket.velocity[3 * i + k];
    // Rounding keeps the order of times: what is finite at both ends is so between them.
    sum += 0.0f * (at + v * (lo - bucket.reference[i]));
    sum += 0.0f * (at + v * (hi - bucket.reference[i]));
  }
  return std::isfinite(sum);
}

// Takes Gaussians that are not finite out of a bucket.
void drop_not_finite(const l4d_timeline& timeline, size_t sh_dim, PreparedBucket* bucket) {
  const float lo = static_cast<float>(timeline.time_begin - bucket->center);
  const float hi =
      static_cast<float>(timeline.time_begin + sequence_duration(timeline) - bucket->center);
  std::vector<RowMove> moves;
  size_t kept = 0;
  for (size_t i = 0; i < bucket->count; ++i) {
    if (!is_finite(*bucket, i, lo, hi)) continue;
    if (!moves.empty() && moves.back().from + moves.back().count == i) {
      ++moves.back().count;
    } else {
      moves.push_back({i, kept, 1});
    }
    ++kept;
  }
  if (kept == bucket->count) return;
  bucket->count = kept;
  const auto move = [&](std::vector<float>& rows, size_t dim) {
    if (!rows.empty()) move_rows(moves, dim, rows.data());
  };
  move(bucket->position, 3);
  move(bucket->mean, 1);
  move(bucket->reference, 1);
  move(bucket->velocity, 3);
  move(bucket->lambda, 1);
  move(bucket->covariance, 6);
  move(bucket->opacity, 1);
  move(bucket->sh, sh_dim);
}

// What one piece of a bucket shows at the instant.
class Slicer {
 public:
  Slicer(const PreparedBucket& bucket, double time, float gate)
      : bucket_(bucket), t_(static_cast<float>(time - bucket.center)), gate_(gate) {}

  bool visible(size_t i) const {
    if (bucket_.permanent) return true;
    const float dt = t_ - bucket_.mean[i];
    return bucket_.lambda[i] * (dt * dt) <= gate_;
  }
  size_t count(size_t begin, size_t end) const {
    if (bucket_.permanent) return end - begin;
    size_t n = 0;
    for (size_t i = begin; i < end; ++i) n += visible(i);
    return n;
  }
  void write(size_t begin, size_t end, size_t at, size_t sh_dim,
             const l4d_splat_buffers& out) const {
    if (bucket_.permanent) return write_all(begin, end, at, sh_dim, out);
    for (size_t i = begin; i < end; ++i) {
      if (!visible(i)) continue;
      if (out.position != nullptr) write_position(i, out.position + 3 * at);
      if (out.covariance != nullptr) {
        std::copy_n(bucket_.covariance.data() + 6 * i, 6, out.covariance + 6 * at);
      }
      if (out.opacity != nullptr) {
        const float dt = t_ - bucket_.mean[i];
        out.opacity[at] = bucket_.opacity[i] * std::exp(-0.5f * (bucket_.lambda[i] * (dt * dt)));
      }
      if (out.sh != nullptr) {
        std::copy_n(bucket_.sh.data() + sh_dim * i, sh_dim, out.sh + sh_dim * at);
      }
      if (out.sh_rows != nullptr) out.sh_rows[at] = bucket_.sh.data() + sh_dim * i;
      ++at;
    }
  }

 private:
  void write_position(size_t i, float* out) const {
    for (size_t k = 0; k < 3; ++k) {
      float p = bucket_.position[3 * i + k];
      if (!bucket_.velocity.empty()) {
        p += bucket_.velocity[3 * i + k] * (t_ - bucket_.reference[i]);
      }
      out[k] = p;
    }
  }
  // Rows of a permanent bucket, which are all there: copies, but for the positions of what moves.
  void write_all(size_t begin, size_t end, size_t at, size_t sh_dim,
                 const l4d_splat_buffers& out) const {
    const size_t n = end - begin;
    const auto copy = [&](const std::vector<float>& from, size_t width, float* to) {
      if (to != nullptr) std::copy_n(from.data() + width * begin, width * n, to + width * at);
    };
    if (bucket_.velocity.empty()) {
      copy(bucket_.position, 3, out.position);
    } else if (out.position != nullptr) {
      for (size_t i = 0; i < n; ++i) write_position(begin + i, out.position + 3 * (at + i));
    }
    copy(bucket_.covariance, 6, out.covariance);
    copy(bucket_.opacity, 1, out.opacity);
    copy(bucket_.sh, sh_dim, out.sh);
    for (size_t i = 0; i < n && out.sh_rows != nullptr; ++i) {
      out.sh_rows[at + i] = bucket_.sh.data() + sh_dim * (begin + i);
    }
  }

  const PreparedBucket& bucket_;
  float t_;
  float gate_;
};

// A page that is lost altogether counts for both of its parts.
size_t count_parts(const LostPages& lost) {
  size_t parts = 0;
  for (const LostPage& page : lost) parts += page.detail_only ? 1 : 2;
  return parts;
}

}  // namespace

Status Decoder::set_detail(uint32_t detail) {
  if (detail > L4D_DETAIL_BASE_COLOR) return invalid_argument("unknown detail");
  detail_ = detail;
  return {};
}

void Decoder::evict(uint64_t needed) {
  // The cache gives way to its own budget and to the limit on all memory.
  const auto fits = [&] {
    return cache_bytes_ + needed <= options_.cache_bytes && file_->memory().has_room(needed);
  };
  while (!cache_.empty() && !fits()) {
    auto oldest = cache_.end();
    for (auto it = cache_.begin(); it != cache_.end(); ++it) {
      if (it->second.last_use == clock_) continue;  // wanted by the query at hand
      if (oldest == cache_.end() || it->second.last_use < oldest->second.last_use) oldest = it;
    }
    if (oldest == cache_.end()) return;
    drop(oldest);
  }
}

void Decoder::drop(std::map<BucketKey, CacheEntry>::iterator entry) {
  cache_bytes_ -= entry->second.memory_bytes;
  file_->memory().release(entry->second.memory_bytes);
  cache_.erase(entry);
}

void Decoder::drop_cache() {
  cache_.clear();
  if (file_ != nullptr) file_->memory().release(cache_bytes_);
  cache_bytes_ = 0;
}

Status Decoder::prepare_range(const Plan& plan, size_t range, size_t first_task, size_t end_task,
                              CacheEntry* entry) {
  PreparedBucket* const out = &entry->bucket;
  const l4d_range& r = plan.ranges[range];
  const SceneHeader& header = file_->header();
  const LayerHeader& layer = header.layers[r.layer];
  size_t n = static_cast<size_t>(r.count);
  out->permanent = layer.permanent;
  out->center = r.center;
  out->position.resize(3 * n);
  out->mean.resize(n);
  out->opacity.resize(n);
  out->sh.resize(header.sh_dim() * n);
  MemoryCharge scratch(file_->memory());
  L4D_RETURN_IF_ERROR(scratch.take(uint64_t{n} * 12 * sizeof(float), "a bucket"));
  std::vector<float> log_scale(4 * n), rotor(8 * n);
  l4d_gaussian_buffers buffers{};
  buffers.struct_size = sizeof buffers;
  buffers.position = out->position.data();
  buffers.mean_t_local = out->mean.data();
  buffers.opacity = out->opacity.data();
  buffers.sh = out->sh.data();
  buffers.log_scale = log_scale.data();
  buffers.rotor = rotor.data();
  // The arrays hold this range alone.
  Plan part;
  part.detail = plan.detail;
  part.sh_bytes = plan.sh_bytes;
  part.ranges.push_back(r);
  for (size_t t = first_task; t < end_task; ++t) {
    part.tasks.push_back(plan.tasks[t]);
    part.tasks.back().range = 0;
    part.tasks.back().first -= r.first;
  }
  LostPages lost;
  L4D_RETURN_IF_ERROR(pages_->expand(part, 0, part.tasks.size(), buffers, progress("decode"),
                                     losses_if_tolerant() == nullptr ? nullptr : &lost));
  if (!lost.empty()) {
    losses_.add_pages(part, lost);
    entry->missing.detail = part.detail;
    entry->missing.sh_bytes = part.sh_bytes;
    entry->missing.ranges = part.ranges;
    entry->lost_parts = count_parts(lost);
    for (const LostPage& page : lost) entry->missing.tasks.push_back(part.tasks[page.task]);
    const std::vector<RowMove> moves = remove_lost(lost, &part);
    n = static_cast<size_t>(part.num_gaussians);
    move_rows(moves, 3, buffers.position);
    move_rows(moves, 1, buffers.mean_t_local);
    move_rows(moves, 1, buffers.opacity);
    move_rows(moves, header.sh_dim(), buffers.sh);
    move_rows(moves, 4, buffers.log_scale);
    move_rows(moves, 8, buffers.rotor);
  }
  out->count = n;
  out->reference.resize(n);
  out->covariance.resize(6 * n);
  if (!layer.permanent) out->lambda.resize(n);
  if (layer.component[L4D_COMPONENT_ROTOR_TEMPORAL].coding != ComponentCodingId::kZero) {
    out->velocity.resize(3 * n);
  }
  parallel_for(static_cast<int>(options_.threads), n, kSliceGrain, [&](size_t begin, size_t end) {
    prepare_gaussians(header, layer, rotor.data(), log_scale.data(), begin, end, out);
  });
  drop_not_finite(header.timeline, header.sh_dim(), out);
  const auto& velocity = out->velocity;
  if (std::all_of(velocity.begin(), velocity.end(), [](float v) { return v == 0; })) {
    std::vector<float>().swap(out->velocity);
  }
  ++buckets_decoded_;
  return {};
}

Status Decoder::has_recovered(const CacheEntry& entry, bool* recovered) {
  *recovered = false;
  if (entry.missing.tasks.empty()) return {};
  LostPages lost;
  L4D_RETURN_IF_ERROR(pages_->probe(entry.missing, &lost));
  *recovered = count_parts(lost) < entry.lost_parts;
  if (!*recovered) losses_.add_pages(entry.missing, lost);
  return {};
}

Status Decoder::prepare(const Plan& plan, std::vector<const CacheEntry*>* out) {
  ++clock_;
  const unsigned sh_dim = file_->header().sh_dim();
  for (const l4d_range& r : plan.ranges) {
    const auto it = cache_.find({r.layer, r.bucket, plan.detail});
    if (it != cache_.end()) it->second.last_use = clock_;
  }
  size_t task = 0;
  for (size_t i = 0; i < plan.ranges.size(); ++i) {
    const l4d_range& r = plan.ranges[i];
    const size_t first_task = task;
    while (task < plan.tasks.size() && plan.tasks[task].range == i) ++task;
    const BucketKey key(r.layer, r.bucket, plan.detail);
    const auto it = cache_.find(key);
    if (it != cache_.end()) {
      bool recovered = false;
      L4D_RETURN_IF_ERROR(has_recovered(it->second, &recovered));
      if (!recovered) {
        ++cache_hits_;
        out->push_back(&it->second);
        continue;
      }
      drop(it);
    }
    CacheEntry entry;
    entry.memory_bytes = PreparedBucket::memory_bytes(static_cast<size_t>(r.count), sh_dim);
    entry.last_use = clock_;
    // Decoding a bucket takes scratch of less than its own size beside it.
    evict(2 * entry.memory_bytes);
    MemoryCharge charge(file_->memory());
    L4D_RETURN_IF_ERROR(charge.take(entry.memory_bytes, "the bucket cache"));
    L4D_RETURN_IF_ERROR(prepare_range(plan, i, first_task, task, &entry));
    entry.number = ++numbered_;
    const uint64_t memory_bytes = entry.memory_bytes;
    const CacheEntry* const kept = &(cache_[key] = std::move(entry));
    charge.keep();
    cache_bytes_ += memory_bytes;
    out->push_back(kept);
  }
  return {};
}

size_t Decoder::leading_still(const std::vector<const CacheEntry*>& buckets) {
  std::vector<uint64_t> numbers;
  for (size_t b = 0; b < buckets.size() && buckets[b]->bucket.still(); ++b) {
    numbers.push_back(buckets[b]->number);
  }
  if (numbers != still_numbers_) ++still_key_;
  still_numbers_ = std::move(numbers);
  return still_numbers_.size();
}

Status Decoder::slice(double time, l4d_splat_buffers* out) {
  const SceneHeader& header = file_->header();
  const double begin = header.timeline.time_begin;
  if (!(time == time)) return invalid_argument("the time is not a number");
  time = std::clamp(time, begin, begin + sequence_duration(header.timeline));
  l4d_query query{};
  query.struct_size = sizeof query;
  query.kind = L4D_QUERY_TIME;
  query.max_level = ~0u;
  query.time_begin = time;
  query.detail = detail_;
  query.whole_buckets = 1;
  Plan plan;
  std::vector<const CacheEntry*> buckets;
  const auto load = [&]() -> Status {
    L4D_RETURN_IF_ERROR(begin_query(query, &plan));
    buckets.clear();
    return prepare(plan, &buckets);
  };
  Status status = load();
  if (status.code() == L4D_ERR_LIMIT_EXCEEDED && !cache_.empty()) {
    // What earlier instants left must not keep this one from being shown.
    drop_cache();
    status = load();
  }
  if (!status.ok()) return status;

  const uint64_t key_given = out->still_key;
  const size_t still = leading_still(buckets);
  size_t num_still = 0;
  for (size_t b = 0; b < still; ++b) num_still += buckets[b]->bucket.count;
  out->num_still = num_still;
  out->still_key = 0;  // until they are written
  // Pieces of fixed size: first how many each shows, then all write at their offsets.
  struct Piece {
    size_t bucket, begin, end, at;
  };
  std::vector<Piece> pieces;
  const bool kept = key_given == still_key_;
  for (size_t b = kept ? still : 0; b < buckets.size(); ++b) {
    const size_t count = buckets[b]->bucket.count;
    for (size_t i = 0; i < count; i += kSliceGrain) {
      pieces.push_back({b, i, std::min(count, i + kSliceGrain), 0});
    }
  }
  const int threads = static_cast<int>(options_.threads);
  parallel_for(threads, pieces.size(), 1, [&](size_t first, size_t last) {
    for (size_t p = first; p < last; ++p) {
      pieces[p].at = Slicer(buckets[pieces[p].bucket]->bucket, time, header.gate)
                         .count(pieces[p].begin, pieces[p].end);
    }
  });
  size_t total = kept ? num_still : 0;
  for (Piece& p : pieces) {
    const size_t n = p.at;
    p.at = total;
    total += n;
  }
  const bool wants_arrays = out->position != nullptr || out->covariance != nullptr ||
                            out->opacity != nullptr || out->sh != nullptr ||
                            out->sh_rows != nullptr;
  out->count = total;
  if (wants_arrays) {
    if (total > out->capacity) {
      return Status(L4D_ERR_BUFFER_TOO_SMALL, "capacity is " + std::to_string(out->capacity) +
                                                  ", " + std::to_string(total) +
                                                  " Gaussians are visible");
    }
    parallel_for(threads, pieces.size(), 1, [&](size_t first, size_t last) {
      for (size_t p = first; p < last; ++p) {
        Slicer(buckets[pieces[p].bucket]->bucket, time, header.gate)
            .write(pieces[p].begin, pieces[p].end, pieces[p].at, header.sh_dim(), *out);
      }
    });
    out->still_key = still_key_;
  }
  return {};
}

}  // namespace l4d
