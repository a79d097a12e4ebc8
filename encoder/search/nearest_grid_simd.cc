// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "encoder/search/nearest_grid.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "encoder/search/nearest_grid_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "encoder/search/row_distance-inl.h"

HWY_BEFORE_NAMESPACE();
namespace l4d {
namespace HWY_NAMESPACE {
namespace {

using D32 = hn::CappedTag<int32_t, 16>;
using V32 = hn::Vec<D32>;

constexpr size_t kGroup = NearestGrid::kGroup;
constexpr size_t kTile = 32;  // points that share each load of a group from the second-level cache
constexpr size_t kRows = 4;   // points at a time, whose sums stay in registers
constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr uint32_t kOutside = ~uint32_t{0};
constexpr int32_t kAll = std::numeric_limits<int32_t>::max();

// Adds the products of a pair of integers with those of each lane. Some targets keep half of each
// sum in `more` until `total` adds it.
HWY_INLINE V32 add_products(const int16_t* HWY_RESTRICT cells, const int16_t* HWY_RESTRICT pair,
                            V32 sum, V32& more) {
  const D32 d;
#if HWY_TARGET == HWY_SCALAR
  (void)more;
  return hn::Add(sum, hn::Set(d, cells[0] * pair[0] + cells[1] * pair[1]));
#else
  const hn::Repartition<int16_t, D32> d16;
  int32_t both;
  std::memcpy(&both, pair, sizeof both);
  return hn::ReorderWidenMulAccumulate(d, hn::Load(d16, cells), hn::BitCast(d16, hn::Set(d, both)),
                                       sum, more);
#endif
}

HWY_INLINE V32 total(V32 sum, V32 more) {
#if HWY_TARGET == HWY_SCALAR
  (void)more;
  return sum;
#else
  return hn::RearrangeToOddPlusEven(sum, more);
#endif
}

class GridSearch {
 public:
  GridSearch(const NearestGrid& grid, const NearestJob& job)
      : grid_(grid),
        job_(job),
        slots_(grid.num_groups() * kGroup),
        place_(kTile * grid.num_pairs() * 2, int16_t{0}),
        scores_(hwy::AllocateAligned<int32_t>(std::max<size_t>(1, kTile * slots_))),
        scale_(1 + static_cast<double>(grid.dim + 8) * 0x1p-23),
        slack_(std::sqrt(static_cast<double>(grid.dim)) *
               (0x1p-62 + static_cast<double>(grid.most) * grid.step * 0x1p-48)) {}

  void run(size_t begin, size_t end) {
    for (size_t tile = begin; tile < end; tile += kTile) {
      const size_t count = std::min(kTile, end - tile);
      for (size_t i = 0; i < count; ++i) put_on_grid(tile + i, i);
      std::fill_n(least_, kTile * kLanes, kAll);
      for (size_t group = 0; group < grid_.num_groups(); ++group) {
        for (size_t i = 0; i < count; i += kRows) score(group, i);
      }
      for (size_t i = 0; i < count; ++i) finish(tile + i, i);
    }
  }

 private:
  static constexpr size_t kLanes = 16;  // at most

  // The integers of a point, and how far it is from them: infinitely if they say nothing about it.
  void put_on_grid(size_t point, size_t i) {
    constexpr double kToInteger = 0x1.8p52;  // a sum with it has no fraction
    const float* row = job_.points + point * grid_.dim;
    int16_t* place = place_.data() + i * grid_.num_pairs() * 2;
    const double most = static_cast<double>(grid_.most), per_step = 1 / grid_.step;
    double squares = 0;
    int32_t norm = 0;
    for (size_t j = 0; j < grid_.dim; ++j) {
      const double v = static_cast<double>(row[j]) - grid_.origin[j];
      const double inside = std::max(-most, std::min(most, v * per_step));
      const double at = (inside + kToInteger) - kToInteger;
      const double e = v - at * grid_.step;
      squares += e * e;
      const int32_t integer = static_cast<int32_t>(at);
      place[j] = static_cast<int16_t>(integer);
      norm += integer * integer;
    }
    const double error = std::sqrt(squares);
    error_[i] = std::isfinite(error) ? error : std::numeric_limits<double>::infinity();
    norm_[i] = static_cast<double>(norm);
  }

  // Squared distances on the grid, without the norm of the point, of a group to kRows points.
  void score(size_t group, size_t i) {
    const D32 d;
    for (size_t l = 0; l < kGroup; l += 2 * hn::Lanes(d)) score_vectors(group, i, l);
  }

  HWY_INLINE void score_vectors(size_t group, size_t i, size_t l) {
    const D32 d;
    const size_t lanes = hn::Lanes(d);
    const size_t pairs = grid_.num_pairs();
    const int16_t* HWY_RESTRICT cells = grid_.cells.get() + (group * pairs * kGroup + l) * 2;
    const int16_t* HWY_RESTRICT place = place_.data() + i * pairs * 2;
    V32 sum[kRows][2], more[kRows][2];
    for (size_t r = 0; r < kRows; ++r) {
      for (size_t h = 0; h < 2; ++h) sum[r][h] = more[r][h] = hn::Zero(d);
    }
    for (size_t j = 0; j < pairs; ++j, cells += 2 * kGroup) {
      for (size_t r = 0; r < kRows; ++r) {
        const int16_t* pair = place + (r * pairs + j) * 2;
        for (size_t h = 0; h < 2; ++h) {
          sum[r][h] = add_products(cells + h * 2 * lanes, pair, sum[r][h], more[r][h]);
        }
      }
    }
    const int32_t* norms = grid_.norms.get() + group * kGroup + l;
    for (size_t r = 0; r < kRows; ++r) {
      int32_t* least = least_ + (i + r) * kLanes;
      V32 lowest = hn::Load(d, least);
      for (size_t h = 0; h < 2; ++h) {
        const V32 score = hn::Add(total(sum[r][h], more[r][h]), hn::Load(d, norms + h * lanes));
        hn::Store(score, d, scores_.get() + (i + r) * slots_ + group * kGroup + l + h * lanes);
        lowest = hn::Min(lowest, score);
      }
      hn::Store(lowest, d, least);
    }
  }

  void consider(uint32_t codeword) {
    const float distance =
        row_distance(row_, grid_.codebook + size_t{codeword} * grid_.dim, grid_.dim);
    // What is known wins ties, then the lowest codeword does.
    if (distance < best_ || (distance == best_ && codeword < label_ && label_ != kOutside)) {
      label_ = codeword;
      best_ = distance;
    }
  }

  // The highest score that the nearest codeword may have.
  int32_t score_limit(size_t i) const {
    const int32_t* lanes = least_ + i * kLanes;
    const double least = static_cast<double>(*std::min_element(lanes, lanes + kLanes));
    const double off = error_[i] + grid_.largest_error;
    const double reach = std::min(std::sqrt(std::max(0.0, least + norm_[i])) * grid_.step + off,
                                  std::sqrt(static_cast<double>(best_)));
    const double limit = (reach * scale_ + slack_ + off * scale_) / grid_.step;
    const double score = limit * limit - norm_[i] + 1;
    return score < static_cast<double>(kAll) ? static_cast<int32_t>(score) : kAll;
  }

  void finish(size_t point, size_t i) {
    row_ = job_.points + point * grid_.dim;
    best_ = kInfinity;
    label_ = 0;
    if (job_.keep_known) {
      best_ = job_.sq_dist[point];
      label_ = kOutside;
    } else if (job_.hint != nullptr && job_.hint[point] < grid_.k) {
      consider(job_.hint[point]);
    }
    for (const uint32_t codeword : grid_.far) consider(codeword);
    look_below(score_limit(i), scores_.get() + i * slots_);
    if (label_ == kOutside) return;
    job_.labels[point] = job_.first_label + label_;
    job_.sq_dist[point] = best_;
  }

  void look_below(int32_t limit, const int32_t* HWY_RESTRICT scores) {
    const D32 d;
    const size_t lanes = hn::Lanes(d);
    const V32 most = hn::Set(d, limit);
    for (size_t slot = 0; slot < slots_; slot += lanes) {
      const auto open = hn::Not(hn::Gt(hn::Load(d, scores + slot), most));
      if (hn::AllFalse(d, open)) continue;
      uint8_t bytes[8] = {0};
      hn::StoreMaskBits(d, open, bytes);
      unsigned bits = unsigned{bytes[0]} | unsigned{bytes[1]} << 8;
      for (; bits != 0; bits &= bits - 1) {
        const size_t at = slot + hwy::Num0BitsBelowLS1Bit_Nonzero32(bits);
        if (at < grid_.order.size()) consider(grid_.order[at]);
      }
    }
  }

  const NearestGrid& grid_;
  const NearestJob& job_;
  const size_t slots_;
  std::vector<int16_t> place_;                   // [kTile, num_pairs, 2]
  hwy::AlignedFreeUniquePtr<int32_t[]> scores_;  // [kTile, slots_]
  HWY_ALIGN int32_t least_[kTile * kLanes];      // of scores, by lane
  double error_[kTile], norm_[kTile];
  const double scale_;  // holds the rounding of squared distances
  const double slack_;  // holds that of subnormal ones, and that of the grid in double
  const float* row_ = nullptr;
  float best_ = kInfinity;
  uint32_t label_ = 0;
};

void search_range(const NearestGrid& grid, const NearestJob& job, size_t begin, size_t end) {
  GridSearch(grid, job).run(begin, end);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace l4d
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace l4d {
namespace {
HWY_EXPORT(search_range);
}  // namespace

void search_grid(const NearestGrid& grid, const NearestJob& job, size_t begin, size_t end) {
  HWY_DYNAMIC_DISPATCH(search_range)(grid, job, begin, end);
}

}  // namespace l4d
#endif  // HWY_ONCE
