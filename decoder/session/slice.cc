// SPDX-License-Identifier: Apache-2.0
// 3D Gaussians at an instant, from cached buckets.
#include "libl4dcodec/scene/slice.h"

#include <algorithm>
#include <cstring>

#include "decoder/session/decoder.h"
#include "l4d/attributes.hpp"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

constexpr size_t kSliceGrain = 4096;
// What the rows are that stand at the beginning of an output.
constexpr uint64_t kStillBuckets = 0, kStillColumns = 1;

// A piece of what an instant shows: rows of one bucket, and where they go.
struct Piece {
  const PreparedBucket* bucket;
  size_t begin, end, at;
};

// Turns the counts of pieces into places, from `first` on; returns where the last one ends.
size_t place(std::vector<Piece>* pieces, size_t first) {
  for (Piece& p : *pieces) {
    const size_t n = p.at;
    p.at = first;
    first += n;
  }
  return first;
}

void add_pieces(const PreparedBucket& bucket, size_t begin, size_t end,
                std::vector<Piece>* pieces) {
  for (; begin < end; begin += kSliceGrain) {
    pieces->push_back({&bucket, begin, std::min(end, begin + kSliceGrain), 0});
  }
}

// What one piece shows at an instant, in l4d_splat_buffers.
class BufferSlicer {
 public:
  BufferSlicer(const Piece& piece, double time, float gate)
      : piece_(piece), bucket_(*piece.bucket), t_(bucket_.time_in(time)), gate_(gate) {}

  size_t count() const {
    if (bucket_.permanent) return piece_.end - piece_.begin;
    size_t n = 0;
    for (size_t i = piece_.begin; i < piece_.end; ++i) n += bucket_.is_visible(i, t_, gate_);
    return n;
  }
  void write(size_t sh_dim, const l4d_splat_buffers& out) const {
    if (bucket_.permanent) return write_all(sh_dim, out);
    size_t at = piece_.at;
    for (size_t i = piece_.begin; i < piece_.end; ++i) {
      if (!bucket_.is_visible(i, t_, gate_)) continue;
      if (out.position != nullptr) bucket_.position_at(i, t_, out.position + 3 * at);
      if (out.covariance != nullptr) {
        std::copy_n(bucket_.covariance.data() + 6 * i, 6, out.covariance + 6 * at);
      }
      if (out.opacity != nullptr) out.opacity[at] = bucket_.opacity_at(i, t_);
      if (out.sh != nullptr) {
        std::copy_n(bucket_.sh.data() + sh_dim * i, sh_dim, out.sh + sh_dim * at);
      }
      if (out.sh_rows != nullptr) out.sh_rows[at] = bucket_.sh.data() + sh_dim * i;
      ++at;
    }
  }

 private:
  // Rows of a permanent bucket, which are all there: copies, but for the positions of what moves.
  void write_all(size_t sh_dim, const l4d_splat_buffers& out) const {
    const size_t n = piece_.end - piece_.begin;
    const auto copy = [&](const std::vector<float>& from, size_t width, float* to) {
      if (to != nullptr) {
        std::copy_n(from.data() + width * piece_.begin, width * n, to + width * piece_.at);
      }
    };
    if (!bucket_.moves()) {
      copy(bucket_.position, 3, out.position);
    } else if (out.position != nullptr) {
      for (size_t i = 0; i < n; ++i) {
        bucket_.position_at(piece_.begin + i, t_, out.position + 3 * (piece_.at + i));
      }
    }
    copy(bucket_.covariance, 6, out.covariance);
    copy(bucket_.opacity, 1, out.opacity);
    copy(bucket_.sh, sh_dim, out.sh);
    for (size_t i = 0; i < n && out.sh_rows != nullptr; ++i) {
      out.sh_rows[piece_.at + i] = bucket_.sh.data() + sh_dim * (piece_.begin + i);
    }
  }

  const Piece& piece_;
  const PreparedBucket& bucket_;
  float t_;
  float gate_;
};

// The same in l4d_splat_columns; pieces are of the bucket's order.
class ColumnSlicer {
 public:
  ColumnSlicer(const Piece& piece, double time)
      : bucket_(*piece.bucket), t_(bucket_.time_in(time)), at_(piece.at) {
    const PreparedBucket::Order& order = bucket_.order;
    fades_ = piece.begin >= order.num_still && !bucket_.permanent;
    moves_ = piece.begin >= order.num_unmoving;
    const uint32_t* row = order.row.data();
    if (!fades_) {
      n_ = piece.end - piece.begin;
      std::copy_n(row + piece.begin, n_, row_);
      return;
    }
    for (size_t k = piece.begin; k < piece.end; ++k) {
      row_[n_] = row[k];
      n_ += bucket_.is_visible(row[k], t_, order.reach[row[k]]);
    }
  }

  size_t count() const { return n_; }
  void write(size_t sh_dim, const l4d_splat_columns& out) const {
    for (size_t j = 0; j < n_; j += kBlock) write_block(j, std::min(n_ - j, kBlock), out);
    for (size_t j = 0; j < n_; ++j) {
      const size_t i = row_[j];
      out.opacity[at_ + j] = fades_ ? bucket_.opacity_at(i, t_) : bucket_.opacity[i];
      out.sh_rows[at_ + j] = bucket_.sh.data() + sh_dim * i;
    }
  }

 private:
  // Columns that begin at the same place of a page take each other's lines of the cache, so each is
  // written for some rows at a time.
  static constexpr size_t kBlock = 64;
  void write_block(size_t first, size_t n, const l4d_splat_columns& out) const {
    float position[3][kBlock], covariance[6][kBlock];
    for (size_t j = 0; j < n; ++j) {
      const size_t i = row_[first + j];
      const float* p = bucket_.position.data() + 3 * i;
      const float* c = bucket_.covariance.data() + 6 * i;
      for (size_t k = 0; k < 3; ++k) position[k][j] = p[k];
      for (size_t k = 0; k < 6; ++k) covariance[k][j] = c[k];
    }
    for (size_t j = 0; j < n && moves_; ++j) {
      float moved[3];
      bucket_.position_at(row_[first + j], t_, moved);
      for (size_t k = 0; k < 3; ++k) position[k][j] = moved[k];
    }
    for (size_t k = 0; k < 3; ++k) std::copy_n(position[k], n, out.position[k] + at_ + first);
    for (size_t k = 0; k < 6; ++k) std::copy_n(covariance[k], n, out.covariance[k] + at_ + first);
  }

  const PreparedBucket& bucket_;
  float t_;
  size_t at_;
  bool fades_, moves_;
  size_t n_ = 0;
  uint32_t row_[kSliceGrain + 1];
};

Status check_columns(const l4d_splat_columns& out) {
  if (!(out.least_opacity >= 0)) return invalid_argument("least_opacity is below 0");
  if (out.capacity == 0) return {};
  bool all = out.opacity != nullptr && out.sh_rows != nullptr;
  for (const float* axis : out.position) all = all && axis != nullptr;
  for (const float* entry : out.covariance) all = all && entry != nullptr;
  return all ? Status() : invalid_argument("an array is NULL");
}

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
  const unsigned sh_dim = header.sh_dim();
  size_t n = static_cast<size_t>(r.count);
  out->permanent = layer.permanent;
  out->center = r.center;
  out->position.resize(3 * n);
  out->mean.resize(n);
  out->opacity.resize(n);
  out->sh.resize(sh_dim * n);
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
    for_each_decoded([&](const AttributeInfo& a,
                         float* rows) { move_rows(moves, a.numbers(header.sh_degree), rows); },
                     buffers);
  }
  out->count = n;
  out->reference.resize(n);
  out->covariance.resize(6 * n);
  if (!layer.permanent) out->lambda.resize(n);
  if (layer.component[L4D_COMPONENT_ROTOR_TEMPORAL].coding != ComponentCodingId::kZero) {
    out->velocity.resize(3 * n);
  }
  parallel_for(static_cast<int>(options_.threads), n, kSliceGrain, [&](size_t begin, size_t end) {
    out->prepare(header, rotor.data(), log_scale.data(), begin, end);
  });
  out->finish(header.timeline, sh_dim);
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

Status Decoder::prepare(const Plan& plan, std::vector<CacheEntry*>* out) {
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
    CacheEntry* const kept = &(cache_[key] = std::move(entry));
    charge.keep();
    cache_bytes_ += memory_bytes;
    out->push_back(kept);
  }
  return {};
}

Status Decoder::load_instant(double* time, std::vector<CacheEntry*>* buckets) {
  if (!(*time == *time)) return invalid_argument("the time is not a number");
  const Sequence sequence = sequence_of(file_->header().timeline);
  *time = std::clamp(*time, sequence.begin, sequence.end);
  l4d_query query{};
  query.struct_size = sizeof query;
  query.kind = L4D_QUERY_TIME;
  query.max_level = ~0u;
  query.time_begin = *time;
  query.detail = detail_;
  query.whole_buckets = 1;
  const auto load = [&]() -> Status {
    Plan plan;
    L4D_RETURN_IF_ERROR(begin_query(query, &plan));
    buckets->clear();
    return prepare(plan, buckets);
  };
  Status status = load();
  if (status.code() == L4D_ERR_LIMIT_EXCEEDED && !cache_.empty()) {
    // What earlier instants left must not keep this one from being shown.
    drop_cache();
    status = load();
  }
  return status;
}

void Decoder::set_still(std::vector<uint64_t> rows) {
  if (rows != still_rows_) ++still_key_;
  still_rows_ = std::move(rows);
}

Status Decoder::slice(double time, l4d_splat_buffers* out) {
  std::vector<CacheEntry*> buckets;
  L4D_RETURN_IF_ERROR(load_instant(&time, &buckets));
  const SceneHeader& header = file_->header();
  const uint64_t key_given = out->still_key;
  size_t still = 0, num_still = 0;
  std::vector<uint64_t> numbers = {kStillBuckets};
  for (; still < buckets.size() && buckets[still]->bucket.still(); ++still) {
    numbers.push_back(buckets[still]->number);
    num_still += buckets[still]->bucket.count;
  }
  set_still(std::move(numbers));
  out->num_still = num_still;
  out->still_key = 0;  // until they are written
  // Pieces of fixed size: first how many each shows, then all write at their offsets.
  std::vector<Piece> pieces;
  const bool kept = key_given == still_key_;
  for (size_t b = kept ? still : 0; b < buckets.size(); ++b) {
    add_pieces(buckets[b]->bucket, 0, buckets[b]->bucket.count, &pieces);
  }
  const int threads = static_cast<int>(options_.threads);
  parallel_for(threads, pieces.size(), 1, [&](size_t first, size_t last) {
    for (size_t p = first; p < last; ++p) {
      pieces[p].at = BufferSlicer(pieces[p], time, header.gate).count();
    }
  });
  const size_t total = place(&pieces, kept ? num_still : 0);
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
        BufferSlicer(pieces[p], time, header.gate).write(header.sh_dim(), *out);
      }
    });
    out->still_key = still_key_;
  }
  return {};
}

Status Decoder::slice(double time, l4d_splat_columns* out) {
  L4D_RETURN_IF_ERROR(check_columns(*out));
  std::vector<CacheEntry*> buckets;
  L4D_RETURN_IF_ERROR(load_instant(&time, &buckets));
  const SceneHeader& header = file_->header();
  const uint64_t key_given = out->still_key;
  size_t num_still = 0;
  uint32_t least_bits;
  std::memcpy(&least_bits, &out->least_opacity, sizeof least_bits);
  std::vector<uint64_t> numbers = {kStillColumns, least_bits};
  for (CacheEntry* entry : buckets) {
    entry->bucket.sort(header.timeline, header.gate, out->least_opacity);
    if (entry->bucket.order.num_still == 0) continue;
    numbers.push_back(entry->number);
    num_still += entry->bucket.order.num_still;
  }
  set_still(std::move(numbers));
  const bool kept = key_given == still_key_;
  std::vector<Piece> pieces;
  for (CacheEntry* entry : buckets) {
    if (!kept) add_pieces(entry->bucket, 0, entry->bucket.order.num_still, &pieces);
  }
  for (CacheEntry* entry : buckets) {
    const PreparedBucket::Order& order = entry->bucket.order;
    add_pieces(entry->bucket, order.num_still, order.num_unmoving, &pieces);
    add_pieces(entry->bucket, order.num_unmoving, order.row.size(), &pieces);
  }
  const int threads = static_cast<int>(options_.threads);
  parallel_for(threads, pieces.size(), 1, [&](size_t first, size_t last) {
    for (size_t p = first; p < last; ++p) pieces[p].at = ColumnSlicer(pieces[p], time).count();
  });
  out->count = place(&pieces, kept ? num_still : 0);
  out->num_still = num_still;
  out->still_key = 0;
  if (out->capacity == 0) return {};  // only the count is wanted
  if (out->count > out->capacity) {
    return Status(L4D_ERR_BUFFER_TOO_SMALL, "capacity is " + std::to_string(out->capacity) + ", " +
                                                std::to_string(out->count) +
                                                " Gaussians are shown");
  }
  parallel_for(threads, pieces.size(), 1, [&](size_t first, size_t last) {
    for (size_t p = first; p < last; ++p) {
      ColumnSlicer(pieces[p], time).write(header.sh_dim(), *out);
    }
  });
  out->still_key = still_key_;
  return {};
}

}  // namespace l4d
