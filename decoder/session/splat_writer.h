// SPDX-License-Identifier: Apache-2.0
// Writes what buckets show at an instant, piece by piece, to the arrays of a caller.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "decoder/session/bucket.h"

namespace l4d {

constexpr size_t kSliceGrain = 4096;

// A piece of what an instant shows: rows of one bucket, and where they go.
struct Piece {
  const PreparedBucket* bucket;
  size_t begin, end, at;
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

}  // namespace l4d
