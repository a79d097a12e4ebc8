// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/slicer.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>

#include "decoder/session/splat_writer.h"
#include "l4d/experimental/columns.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

// What the rows are that stand at the beginning of an output.
constexpr uint64_t kStillBuckets = 0, kStillColumns = 1;

Status check_camera(bool wants_color, const double* position /* [3] */) {
  for (size_t k = 0; k < 3 && wants_color; ++k) {
    if (!std::isfinite(position[k])) return invalid_argument("camera_position is not finite");
  }
  return {};
}

template <size_t kCount>
bool all_or_none(float* const (&columns)[kCount]) {
  for (const float* column : columns) {
    if ((column == nullptr) != (columns[0] == nullptr)) return false;
  }
  return true;
}

Status check_columns(const l4d_splat_columns& out) {
  if (!(out.min_opacity >= 0)) return invalid_argument("min_opacity is below 0");
  L4D_RETURN_IF_ERROR(check_camera(out.color[0] != nullptr, out.camera_position));
  if (!all_or_none(out.scale) || !all_or_none(out.rotation) || !all_or_none(out.color)) {
    return invalid_argument("only some columns of scale, rotation or color are NULL");
  }
  if (out.capacity == 0) return {};
  bool all = out.opacity != nullptr && out.sh_rows != nullptr;
  for (const float* axis : out.position) all = all && axis != nullptr;
  for (const float* entry : out.covariance) all = all && entry != nullptr;
  return all ? Status() : invalid_argument("an array is NULL");
}

}  // namespace

void Slicer::close() {
  plan_ = Plan();
  ahead_.close();
  cache_.close();
  // Without rows there may be no file.
  if (wide_sh_.capacity() > 0) forget(stream_.file().memory(), &wide_sh_);
}

Status Slicer::load_instant(const l4d_operating_point& point, double* time, bool with_shape) {
  if (!(*time == *time)) return invalid_argument("the time is not a number");
  const Sequence sequence = sequence_of(stream_.file().header().timeline);
  *time = std::clamp(*time, sequence.begin, sequence.end);
  l4d_query query{};
  query.struct_size = sizeof query;
  query.kind = L4D_QUERY_TIME;
  query.time_begin = *time;
  query.point = point;
  query.whole_buckets = 1;
  const auto load = [&](bool ahead) -> Status {
    if (ahead) ahead_.fetch_directory(query);
    L4D_RETURN_IF_ERROR(stream_.plan(query, &plan_));
    if (ahead) ahead_.fetch_buckets(query, plan_, with_shape);
    return cache_.load(plan_, with_shape, &buckets_);
  };
  Status status = load(true);
  ByteSource& source = stream_.file().source();
  if (status.code() == L4D_ERR_LIMIT_EXCEEDED && (!cache_.is_empty() || source.fetches())) {
    // What earlier instants left, and what was read ahead, must not keep this one from being shown.
    cache_.clear();
    plan_ = Plan();
    source.forget();
    status = load(false);
  }
  if (status.ok()) {
    plan_.clear();
  } else {
    plan_ = Plan();
  }
  return status;
}

void Slicer::set_still() {
  if (new_rows_ != still_rows_) ++still_key_;
  still_rows_.swap(new_rows_);
}

Status Slicer::slice(double time, l4d_splat_buffers* out) {
  L4D_RETURN_IF_ERROR(check_camera(out->color != nullptr, out->camera_position));
  const bool with_shape = out->scale != nullptr || out->rotation != nullptr;
  L4D_RETURN_IF_ERROR(load_instant(out->point, &time, with_shape));
  const SceneHeader& header = stream_.file().header();
  const Instant instant(header.timeline, time);
  const uint64_t key_given = out->still_key;
  size_t still = 0, num_still = 0;
  new_rows_.assign(1, kStillBuckets);
  for (; still < buckets_.size() && buckets_[still]->bucket.still(); ++still) {
    new_rows_.push_back(buckets_[still]->number);
    num_still += buckets_[still]->bucket.count;
  }
  set_still();
  out->num_still = num_still;
  out->still_key = 0;  // until they are written
  // Pieces of fixed size: first how many each shows, then all write at their offsets. Of still rows
  // that the caller has, only colours are written.
  std::vector<Piece>& pieces = pieces_;
  pieces.clear();
  const bool kept = key_given == still_key_;
  for (size_t b = kept && out->color == nullptr ? still : 0; b < buckets_.size(); ++b) {
    add_pieces(buckets_[b]->bucket, 0, buckets_[b]->bucket.count, &pieces);
  }
  const int threads = stream_.threads();
  parallel_for(threads, pieces.size(), 1, [&](size_t first, size_t last) {
    for (size_t p = first; p < last; ++p) {
      pieces[p].at = BufferSlicer(pieces[p], instant, header).count();
    }
  });
  const size_t total = place(&pieces, kept && out->color == nullptr ? num_still : 0);
  const bool wants_arrays = out->position != nullptr || out->covariance != nullptr ||
                            out->opacity != nullptr || out->sh != nullptr ||
                            out->sh_rows != nullptr || with_shape || out->color != nullptr ||
                            out->id != nullptr;
  out->count = total;
  if (wants_arrays) {
    if (total > out->capacity) {
      return Status(L4D_ERR_BUFFER_TOO_SMALL, "capacity is " + std::to_string(out->capacity) +
                                                  ", " + std::to_string(total) +
                                                  " Gaussians are visible");
    }
    parallel_for(threads, pieces.size(), 1, [&](size_t first, size_t last) {
      for (size_t p = first; p < last; ++p) {
        const BufferSlicer slicer(pieces[p], instant, header);
        if (kept && pieces[p].at < num_still) {
          slicer.write_colors(*out);
        } else {
          slicer.write(*out);
        }
      }
    });
    out->still_key = still_key_;
  }
  return {};
}

Status Slicer::slice(double time, l4d_splat_columns* out) {
  L4D_RETURN_IF_ERROR(check_columns(*out));
  const bool with_shape = out->scale[0] != nullptr || out->rotation[0] != nullptr;
  L4D_RETURN_IF_ERROR(load_instant(out->point, &time, with_shape));
  const SceneHeader& header = stream_.file().header();
  const Instant instant(header.timeline, time);
  const uint64_t key_given = out->still_key;
  size_t num_still = 0;
  uint32_t min_bits;
  std::memcpy(&min_bits, &out->min_opacity, sizeof min_bits);
  new_rows_.assign({kStillColumns, min_bits});
  for (CachedBucket* entry : buckets_) {
    entry->bucket.sort(header.timeline, header.gate, out->min_opacity);
    if (entry->bucket.order.num_still == 0) continue;
    new_rows_.push_back(entry->number);
    num_still += entry->bucket.order.num_still;
  }
  set_still();
  const bool kept = key_given == still_key_;
  std::vector<Piece>& pieces = pieces_;
  pieces.clear();
  const bool without_still = kept && out->color[0] == nullptr;
  for (CachedBucket* entry : buckets_) {
    if (!without_still) add_pieces(entry->bucket, 0, entry->bucket.order.num_still, &pieces);
  }
  for (CachedBucket* entry : buckets_) {
    const PreparedBucket::Order& order = entry->bucket.order;
    add_pieces(entry->bucket, order.num_still, order.num_unmoving, &pieces);
    add_pieces(entry->bucket, order.num_unmoving, order.row.size(), &pieces);
  }
  const int threads = stream_.threads();
  parallel_for(threads, pieces.size(), 1, [&](size_t first, size_t last) {
    for (size_t p = first; p < last; ++p)
      pieces[p].at = ColumnSlicer(pieces[p], instant, header).count();
  });
  out->count = place(&pieces, without_still ? num_still : 0);
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
      const ColumnSlicer slicer(pieces[p], instant, header);
      if (kept && pieces[p].at < num_still) {
        slicer.write_colors(*out);
      } else {
        slicer.write(*out);
      }
    }
  });
  out->still_key = still_key_;
  return {};
}

Status Slicer::widen_rows(size_t known, size_t width, size_t count, const float** rows) {
  MemoryBudget& memory = stream_.file().memory();
  L4D_RETURN_IF_ERROR(renew(memory, &wide_sh_, count * width, "SH of streams of several degrees"));
  float* to = wide_sh_.data();
  for (size_t i = 0; i < count; ++i, to += width) {
    std::fill(std::copy_n(rows[i], known, to), to + width, 0.0F);
    rows[i] = to;
  }
  return {};
}

}  // namespace l4d
