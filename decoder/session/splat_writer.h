// SPDX-License-Identifier: Apache-2.0
// Writes what buckets show at an instant, piece by piece, to the arrays of a caller.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "decoder/session/bucket.h"
#include "l4d/experimental/columns.h"

namespace l4d {

constexpr size_t kSliceGrain = 4096;

// A piece of what an instant shows: rows of one bucket, and where they go.
struct Piece {
  const PreparedBucket* bucket;
  size_t begin, end, at;
};

// A time of the sequence, and the frame that it belongs to.
struct Instant {
  double time;
  uint32_t frame;
  Instant(const l4d_timeline& timeline, double seconds)
      : time(seconds), frame(frame_of_time(timeline, seconds)) {}
};

// Turns the counts of pieces into places, from `first` on; returns where the last one ends.
inline size_t place(std::vector<Piece>* pieces, size_t first) {
  for (Piece& p : *pieces) {
    const size_t n = p.at;
    p.at = first;
    first += n;
  }
  return first;
}

inline void add_pieces(const PreparedBucket& bucket, size_t begin, size_t end,
                       std::vector<Piece>* pieces) {
  for (; begin < end; begin += kSliceGrain) {
    pieces->push_back({&bucket, begin, std::min(end, begin + kSliceGrain), 0});
  }
}

// What one piece shows at an instant, in l4d_splat_buffers.
class BufferSlicer {
 public:
  BufferSlicer(const Piece& piece, const Instant& instant, const SceneHeader& header)
      : piece_(piece),
        bucket_(*piece.bucket),
        t_(bucket_.time_in(instant.time)),
        frame_(instant.frame),
        header_(header) {}

  size_t count() const {
    if (bucket_.permanent) return piece_.end - piece_.begin;
    size_t n = 0;
    if (bucket_.flat) {
      for (size_t i = piece_.begin; i < piece_.end; ++i) n += bucket_.window[i].holds(frame_);
      return n;
    }
    for (size_t i = piece_.begin; i < piece_.end; ++i) {
      n += bucket_.is_visible(i, t_, header_.gate);
    }
    return n;
  }
  void write(const l4d_splat_buffers& out) const {
    if (bucket_.permanent) return write_all(out);
    if (bucket_.flat) {
      return write_shown(out, [&](size_t i) { return bucket_.window[i].holds(frame_); });
    }
    write_shown(out, [&](size_t i) { return bucket_.is_visible(i, t_, header_.gate); });
  }
  // The colours alone, of rows that are all visible.
  void write_colors(const l4d_splat_buffers& out) const {
    for (size_t i = piece_.begin; i < piece_.end; ++i) {
      write_color(i, piece_.at + i - piece_.begin, out);
    }
  }

 private:
  template <typename IsShown>
  void write_shown(const l4d_splat_buffers& out, const IsShown& is_shown) const {
    size_t at = piece_.at;
    for (size_t i = piece_.begin; i < piece_.end; ++i) {
      if (!is_shown(i)) continue;
      if (out.position != nullptr) bucket_.position_at(i, t_, out.position + 3 * at);
      copy(bucket_.covariance, 6, i, 1, at, out.covariance);
      if (out.opacity != nullptr) out.opacity[at] = bucket_.opacity_at(i, t_);
      copy(bucket_.sh, header_.sh_dim(), i, 1, at, out.sh);
      copy(bucket_.scale, 3, i, 1, at, out.scale);
      copy(bucket_.rotation, 4, i, 1, at, out.rotation);
      write_references(i, at, out);
      if (out.color != nullptr) write_color(i, at, out);
      ++at;
    }
  }

  // Rows of a permanent bucket, which are all there: copies, but for the positions of what moves.
  void write_all(const l4d_splat_buffers& out) const {
    const size_t n = piece_.end - piece_.begin;
    const auto copy_all = [&](const std::vector<float>& from, size_t width, float* to) {
      copy(from, width, piece_.begin, n, piece_.at, to);
    };
    if (!bucket_.moves()) {
      copy_all(bucket_.position, 3, out.position);
    } else if (out.position != nullptr) {
      for (size_t i = 0; i < n; ++i) {
        bucket_.position_at(piece_.begin + i, t_, out.position + 3 * (piece_.at + i));
      }
    }
    copy_all(bucket_.covariance, 6, out.covariance);
    copy_all(bucket_.opacity, 1, out.opacity);
    copy_all(bucket_.sh, header_.sh_dim(), out.sh);
    copy_all(bucket_.scale, 3, out.scale);
    copy_all(bucket_.rotation, 4, out.rotation);
    if (out.sh_rows != nullptr || out.id != nullptr) {
      for (size_t i = 0; i < n; ++i) write_references(piece_.begin + i, piece_.at + i, out);
    }
    if (out.color != nullptr) write_colors(out);
  }

  static void copy(const std::vector<float>& from, size_t width, size_t first, size_t n, size_t at,
                   float* to) {
    if (to != nullptr) std::copy_n(from.data() + width * first, width * n, to + width * at);
  }
  void write_references(size_t i, size_t at, const l4d_splat_buffers& out) const {
    if (out.sh_rows != nullptr) out.sh_rows[at] = bucket_.sh.data() + header_.sh_dim() * i;
    if (out.id != nullptr) out.id[at] = bucket_.id_of(i);
  }
  void write_color(size_t i, size_t at, const l4d_splat_buffers& out) const {
    bucket_.color_at(i, t_, header_.sh_degree, out.camera_position, out.color + 3 * at);
  }

  const Piece& piece_;
  const PreparedBucket& bucket_;
  float t_;
  uint32_t frame_;
  const SceneHeader& header_;
};

// The same in l4d_splat_columns; pieces are of the bucket's order.
class ColumnSlicer {
 public:
  ColumnSlicer(const Piece& piece, const Instant& instant, const SceneHeader& header)
      : bucket_(*piece.bucket), t_(bucket_.time_in(instant.time)), at_(piece.at), header_(header) {
    const PreparedBucket::Order& order = bucket_.order;
    const bool still = piece.begin < order.num_still;
    fades_ = !still && bucket_.fades();
    moves_ = piece.begin >= order.num_unmoving;
    const uint32_t* row = order.row.data();
    if (bucket_.flat && !still) {
      for (size_t k = piece.begin; k < piece.end; ++k) {
        row_[n_] = row[k];
        n_ += bucket_.window[row[k]].holds(instant.frame);
      }
      return;
    }
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
  void write(const l4d_splat_columns& out) const {
    for (size_t j = 0; j < n_; j += kBlock) write_block(j, std::min(n_ - j, kBlock), out);
    for (size_t j = 0; j < n_; ++j) {
      const size_t i = row_[j];
      out.opacity[at_ + j] = fades_ ? bucket_.opacity_at(i, t_) : bucket_.opacity[i];
      out.sh_rows[at_ + j] = bucket_.sh.data() + header_.sh_dim() * i;
    }
    for (size_t j = 0; j < n_ && out.id != nullptr; ++j) out.id[at_ + j] = bucket_.id_of(row_[j]);
    if (out.scale[0] != nullptr) write_columns<3>(bucket_.scale, out.scale);
    if (out.rotation[0] != nullptr) write_columns<4>(bucket_.rotation, out.rotation);
    if (out.color[0] != nullptr) write_colors(out);
  }
  // The colours alone.
  void write_colors(const l4d_splat_columns& out) const {
    for (size_t j = 0; j < n_; ++j) {
      float color[3];
      bucket_.color_at(row_[j], t_, header_.sh_degree, out.camera_position, color);
      for (size_t k = 0; k < 3; ++k) out.color[k][at_ + j] = color[k];
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
  template <size_t kWidth>
  void write_columns(const std::vector<float>& from, float* const (&to)[kWidth]) const {
    for (size_t first = 0; first < n_; first += kBlock) {
      const size_t n = std::min(n_ - first, kBlock);
      float columns[kWidth][kBlock];
      for (size_t j = 0; j < n; ++j) {
        for (size_t k = 0; k < kWidth; ++k) columns[k][j] = from[kWidth * row_[first + j] + k];
      }
      for (size_t k = 0; k < kWidth; ++k) std::copy_n(columns[k], n, to[k] + at_ + first);
    }
  }

  const PreparedBucket& bucket_;
  float t_;
  size_t at_;
  const SceneHeader& header_;
  bool fades_, moves_;
  size_t n_ = 0;
  uint32_t row_[kSliceGrain + 1];
};

}  // namespace l4d
