// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "encoder/search/nearest.h"
#include "encoder/search/nearest_grid.h"
#include "encoder/search/nearest_index.h"
#include "encoder/search/nearest_job.h"
#include "libl4dcodec/base/threads.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "encoder/search/nearest_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "encoder/search/row_distance-inl.h"

HWY_BEFORE_NAMESPACE();
namespace l4d {
namespace HWY_NAMESPACE {
namespace {

constexpr size_t kFan = NearestIndex::kFan;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

HWY_INLINE float sum_of_squares(const float* HWY_RESTRICT v, size_t count) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  V sum = hn::Zero(d);
  size_t j = 0;
  for (; j + lanes <= count; j += lanes) {
    const V a = hn::LoadU(d, v + j);
    sum = hn::MulAdd(a, a, sum);
  }
  float rest = 0;
  for (; j < count; ++j) rest += v[j] * v[j];
  return hn::GetLane(hn::SumOfLanes(d, sum)) + rest;
}

// One point on its way through the tree. kDim is the dimension where it is known at compile time
// and the vectors are their own sketches; 0 for any.
template <size_t kDim, bool kPlain>
class Search {
 public:
  explicit Search(const NearestIndex& index) : index_(index) {}

  // sketch: [sketch_dim]; length: of the centred point, where rounding is relative to it.
  void start(const float* row, const float* sketch, float length) {
    row_ = row;
    sketch_ = sketch;
    slack_ = 2 * length * index_.error_scale;
    label_ = 0;
    set_best(kInfinity);
  }

  void offer(uint32_t codeword) {
    const float* c = index_.codebook + size_t{codeword} * dim();
    float distance;
    if constexpr (kPlain) {
      distance = plain_distance(c);
    } else {
      distance = row_distance(row_, c, dim());
    }
    consider(distance, codeword);
  }

  // The best so far belongs to a codeword outside this index, and wins ties.
  void know(float distance) {
    if (!(distance < kInfinity)) return;
    label_ = kOutside;
    set_best(distance);
  }

  void run() { visit(index_.boxes.size() - 1, 0); }

  size_t leaves() const { return leaves_; }
  bool outside() const { return label_ == kOutside; }
  uint32_t label() const { return label_; }
  float distance() const { return best_; }

 private:
  static constexpr uint32_t kOutside = ~uint32_t{0};

  size_t dim() const { return kDim != 0 ? kDim : index_.dim; }
  size_t box_dim() const { return kDim != 0 ? kDim : index_.box_dim; }

  // The order of operations of scan_leaf and of box bounds, so that bounds hold to the last bit.
  HWY_INLINE float plain_distance(const float* c) const {
    const hn::CappedTag<float, 1> d1;
    auto sum = hn::Zero(d1);
    for (size_t j = 0; j < dim(); ++j) {
      const auto e = hn::Sub(hn::Set(d1, c[j]), hn::Set(d1, sketch_[j]));
      sum = hn::MulAdd(e, e, sum);
    }
    return hn::GetLane(sum);
  }

  HWY_INLINE void set_best(float distance) {
    best_ = distance;
    if constexpr (kPlain) {
      // Rounding is monotonic, so a box is never further than what is in it.
      limit_ = distance;
    } else {
      const float reach = std::sqrt(distance) * (1 + 2 * index_.error_scale) + slack_;
      // Relative bounds end where numbers turn subnormal.
      limit_ = reach * reach + std::numeric_limits<float>::min();
    }
  }

  HWY_INLINE void consider(float distance, uint32_t codeword) {
    // kOutside as the label must win ties, any other label only if it is the lower one.
    if (distance < best_ || (distance == best_ && codeword < label_ && label_ != kOutside)) {
      label_ = codeword;
      set_best(distance);
    }
  }

  HWY_INLINE unsigned within_limit(const float* HWY_RESTRICT bound) const {
    const D d;
    const size_t lanes = hn::Lanes(d);
    const V limit = hn::Set(d, limit_);
    unsigned bits = 0;
    for (size_t l = 0; l < kFan; l += lanes) {
      uint8_t byte[8] = {0};
      hn::StoreMaskBits(d, hn::Le(hn::Load(d, bound + l), limit), byte);
      bits |= unsigned{byte[0]} << l;
    }
    return bits;
  }

  void visit(size_t level, size_t group) {
    const D d;
    const size_t lanes = hn::Lanes(d);
    const size_t dims = box_dim();
    HWY_ALIGN float bound[kFan];
    const float* HWY_RESTRICT box = index_.boxes[level].get() + group * dims * 2 * kFan;
    const V zero = hn::Zero(d);
    for (size_t l = 0; l < kFan; l += 2 * lanes) {
      V sum0 = zero, sum1 = zero;
      for (size_t j = 0; j < dims; ++j) {
        const float* low = box + j * 2 * kFan + l;
        const float* high = low + kFan;
        const V p = hn::Set(d, sketch_[j]);
        const V out0 =
            hn::Max(hn::Max(hn::Sub(hn::Load(d, low), p), hn::Sub(p, hn::Load(d, high))), zero);
        const V out1 = hn::Max(
            hn::Max(hn::Sub(hn::Load(d, low + lanes), p), hn::Sub(p, hn::Load(d, high + lanes))),
            zero);
        sum0 = hn::MulAdd(out0, out0, sum0);
        sum1 = hn::MulAdd(out1, out1, sum1);
      }
      hn::Store(sum0, d, bound + l);
      hn::Store(sum1, d, bound + l + lanes);
    }
    const size_t first = group * kFan;
    const size_t count = std::min(kFan, index_.level_size[level] - first);
    unsigned open = within_limit(bound) & ((1u << count) - 1);
    if (open == 0) return;
    if ((open & (open - 1)) != 0) {
      // The nearest child first: what it holds rules most of the others out.
      size_t nearest = 0;
      for (size_t c = 1; c < count; ++c) nearest = bound[c] < bound[nearest] ? c : nearest;
      descend(level, first + nearest);
      open &= within_limit(bound) & ~(1u << nearest);
    }
    for (; open != 0; open &= open - 1) {
      const size_t c = hwy::Num0BitsBelowLS1Bit_Nonzero32(open);
      if (bound[c] <= limit_) descend(level, first + c);
    }
  }

  HWY_INLINE void descend(size_t level, size_t node) {
    if (level != 0) {
      visit(level - 1, node);
    } else if constexpr (kPlain) {
      scan_plain(node);
    } else {
      scan_sketches(node);
    }
  }

  void scan_plain(size_t leaf) {
    const D d;
    const size_t lanes = hn::Lanes(d);
    const float* HWY_RESTRICT values = index_.leaves.get() + leaf * dim() * kFan;
    HWY_ALIGN float distance[kFan];
    V lowest = hn::Set(d, kInfinity);
    for (size_t l = 0; l < kFan; l += 2 * lanes) {
      V sum0 = hn::Zero(d), sum1 = hn::Zero(d);
      for (size_t j = 0; j < dim(); ++j) {
        const V p = hn::Set(d, sketch_[j]);
        const V e0 = hn::Sub(hn::Load(d, values + j * kFan + l), p);
        const V e1 = hn::Sub(hn::Load(d, values + j * kFan + l + lanes), p);
        sum0 = hn::MulAdd(e0, e0, sum0);
        sum1 = hn::MulAdd(e1, e1, sum1);
      }
      hn::Store(sum0, d, distance + l);
      hn::Store(sum1, d, distance + l + lanes);
      lowest = hn::Min(lowest, hn::Min(sum0, sum1));
    }
    if (hn::AllFalse(d, hn::Le(lowest, hn::Set(d, best_)))) return;
    for (unsigned open = within_limit(distance); open != 0; open &= open - 1) {
      const size_t c = hwy::Num0BitsBelowLS1Bit_Nonzero32(open);
      consider(distance[c], index_.order[leaf * kFan + c]);
    }
  }

  void scan_sketches(size_t leaf) {
    ++leaves_;
    const D d;
    const size_t lanes = hn::Lanes(d);
    const size_t width = index_.sketch_dim();
    const float* HWY_RESTRICT values = index_.leaves.get() + leaf * width * kFan;
    HWY_ALIGN float bound[kFan];
    const V limit = hn::Set(d, limit_);
    bool any = false;
    for (size_t l = 0; l < kFan; l += 2 * lanes) {
      V sum0 = hn::Zero(d), sum1 = hn::Zero(d);
      size_t j = 0;
      const auto add_until = [&](size_t end) {
        for (; j < end; ++j) {
          const V p = hn::Set(d, sketch_[j]);
          const V e0 = hn::Sub(hn::Load(d, values + j * kFan + l), p);
          const V e1 = hn::Sub(hn::Load(d, values + j * kFan + l + lanes), p);
          sum0 = hn::MulAdd(e0, e0, sum0);
          sum1 = hn::MulAdd(e1, e1, sum1);
        }
      };
      add_until(index_.box_dim);
      if (!hn::AllFalse(d, hn::Le(hn::Min(sum0, sum1), limit))) {
        add_until(width);
        any = any || !hn::AllFalse(d, hn::Le(hn::Min(sum0, sum1), limit));
      }
      hn::Store(sum0, d, bound + l);
      hn::Store(sum1, d, bound + l + lanes);
    }
    if (!any) return;
    unsigned open = within_limit(bound);
    const auto look = [&](size_t c) {
      const size_t slot = leaf * kFan + c;
      consider(row_distance(row_, index_.rows.data() + slot * dim(), dim()), index_.order[slot]);
    };
    if (limit_ == kInfinity && open != 0) {
      size_t nearest = hwy::Num0BitsBelowLS1Bit_Nonzero32(open);
      for (size_t c = nearest + 1; c < kFan; ++c) nearest = bound[c] < bound[nearest] ? c : nearest;
      look(nearest);
    }
    for (; open != 0; open &= open - 1) {
      const size_t c = hwy::Num0BitsBelowLS1Bit_Nonzero32(open);
      if (bound[c] <= limit_) look(c);
    }
  }

  const NearestIndex& index_;
  const float* row_ = nullptr;
  const float* sketch_ = nullptr;
  float slack_ = 0;
  float best_ = kInfinity;
  float limit_ = kInfinity;  // sketches further than this cannot be of the nearest codeword
  uint32_t label_ = 0;
  size_t leaves_ = 0;  // looked at, by their sketches
};

// Points a tile, so that a tile of rotated vectors stays in the first-level cache.
constexpr size_t kTile = 32;

// out [count, axes.stride] = (rows - mean) basis. Four points at a time share each load of the
// basis.
void rotate(const NearestIndex& index, const float* rows, size_t count, float* HWY_RESTRICT centred,
            float* HWY_RESTRICT out) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  const size_t dim = index.dim;
  const size_t padded = index.axes.stride;
  for (size_t i = 0; i < count; ++i) {
    for (size_t j = 0; j < dim; ++j)
      centred[i * padded + j] = rows[i * dim + j] - index.axes.mean[j];
  }
  // Rows past the last one are scratch: the tile is a multiple of four.
  for (size_t i = 0; i < count; i += 4) {
    const float* HWY_RESTRICT c0 = centred + i * padded;
    const float* HWY_RESTRICT c1 = c0 + padded;
    const float* HWY_RESTRICT c2 = c1 + padded;
    const float* HWY_RESTRICT c3 = c2 + padded;
    for (size_t l = 0; l < padded; l += 2 * lanes) {
      V s00 = hn::Zero(d), s01 = s00, s10 = s00, s11 = s00;
      V s20 = s00, s21 = s00, s30 = s00, s31 = s00;
      const float* HWY_RESTRICT axis = index.axes.basis.data() + l;
      for (size_t j = 0; j < dim; ++j, axis += padded) {
        const V b0 = hn::LoadU(d, axis), b1 = hn::LoadU(d, axis + lanes);
        const V p0 = hn::Set(d, c0[j]), p1 = hn::Set(d, c1[j]);
        const V p2 = hn::Set(d, c2[j]), p3 = hn::Set(d, c3[j]);
        s00 = hn::MulAdd(p0, b0, s00);
        s01 = hn::MulAdd(p0, b1, s01);
        s10 = hn::MulAdd(p1, b0, s10);
        s11 = hn::MulAdd(p1, b1, s11);
        s20 = hn::MulAdd(p2, b0, s20);
        s21 = hn::MulAdd(p2, b1, s21);
        s30 = hn::MulAdd(p3, b0, s30);
        s31 = hn::MulAdd(p3, b1, s31);
      }
      float* to = out + i * padded + l;
      hn::StoreU(s00, d, to);
      hn::StoreU(s01, d, to + lanes);
      hn::StoreU(s10, d, to + padded);
      hn::StoreU(s11, d, to + padded + lanes);
      hn::StoreU(s20, d, to + 2 * padded);
      hn::StoreU(s21, d, to + 2 * padded + lanes);
      hn::StoreU(s30, d, to + 3 * padded);
      hn::StoreU(s31, d, to + 3 * padded + lanes);
    }
  }
}

template <class S>
HWY_INLINE void finish(S& search, const NearestIndex& index, const NearestJob& job, size_t i) {
  if (job.keep_known) {
    search.know(job.sq_dist[i]);
  } else if (job.hint != nullptr && job.hint[i] < index.k) {
    search.offer(job.hint[i]);
  }
  search.run();
  if (search.outside()) return;
  if (job.keep_known && !(search.distance() < kInfinity)) return;
  job.labels[i] = job.first_label + search.label();
  job.sq_dist[i] = search.distance();
}

template <size_t kDim>
void search_plain(const NearestIndex& index, const NearestJob& job, size_t begin, size_t end) {
  Search<kDim, true> search(index);
  for (size_t i = begin; i < end; ++i) {
    const float* row = job.points + i * index.dim;
    search.start(row, row, 0.0f);
    finish(search, index, job, i);
  }
}

// Returns how many leaves were looked at.
size_t search_sketches(const NearestIndex& index, const NearestJob& job, size_t begin, size_t end) {
  const size_t dim = index.dim;
  const size_t stride = index.rotated() ? index.axes.stride : dim;
  std::vector<float> centred(kTile * index.axes.stride), rotated(centred.size());
  std::vector<float> sketch(index.lead + 1);
  Search<0, false> search(index);
  for (size_t tile = begin; tile < end; tile += kTile) {
    const size_t count = std::min(kTile, end - tile);
    const float* rows = job.points + tile * dim;
    const float* vectors = rows;
    if (index.rotated()) {
      rotate(index, rows, count, centred.data(), rotated.data());
      vectors = rotated.data();
    }
    for (size_t i = 0; i < count; ++i) {
      const float* v = vectors + i * stride;
      const float lead = sum_of_squares(v, index.lead);
      const float tail = sum_of_squares(v + index.lead, dim - index.lead);
      std::copy_n(v, index.lead, sketch.data());
      sketch[index.lead] = std::sqrt(tail);
      search.start(rows + i * dim, sketch.data(), std::sqrt(lead + tail));
      finish(search, index, job, tile + i);
    }
  }
  return search.leaves();
}

size_t search_range(const NearestIndex& index, const NearestJob& job, size_t begin, size_t end) {
  if (!index.plain()) return search_sketches(index, job, begin, end);
  if (index.dim == 3) {
    search_plain<3>(index, job, begin, end);
  } else if (index.dim == 4) {
    search_plain<4>(index, job, begin, end);
  } else {
    search_plain<0>(index, job, begin, end);
  }
  return 0;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace l4d
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace l4d {
namespace {

HWY_EXPORT(search_range);

// Finding axes costs a few milliseconds: not for a handful of points, nor for a single leaf.
bool worth_rotating(size_t n, size_t k, size_t dim) { return n >= 32 * dim && k > 64; }

// Some points are searched by the tree, into arrays of their own. If the tree looks at so many
// codewords that looking at all of them on a grid takes less time, returns the grid, else null.
// Results are the same either way.
std::unique_ptr<NearestGrid> grid_if_faster(const NearestIndex& index, const NearestJob& job,
                                            size_t n) {
  constexpr size_t kSample = 128, kMinPoints = 32 * kSample, kMinCodewords = 64;
  // The time that a leaf takes by the tree, over that on the grid.
  constexpr size_t kLeafCost = 5;
  if (index.plain() || n < kMinPoints || index.k < kMinCodewords) return nullptr;
  const size_t dim = index.dim, step = n / kSample;
  std::vector<float> rows(kSample * dim), sq_dist(kSample);
  std::vector<uint32_t> hint(kSample, ~uint32_t{0}), labels(kSample);
  for (size_t s = 0; s < kSample; ++s) {
    std::copy_n(job.points + s * step * dim, dim, rows.data() + s * dim);
    if (job.hint != nullptr) hint[s] = job.hint[s * step];
    if (job.keep_known) sq_dist[s] = job.sq_dist[s * step];
  }
  const NearestJob some = {rows.data(),   hint.data(),    job.first_label,
                           labels.data(), sq_dist.data(), job.keep_known};
  const size_t leaves = HWY_DYNAMIC_DISPATCH(search_range)(index, some, 0, kSample);
  if (leaves * kLeafCost <= index.num_leaves() * kSample) return nullptr;
  return std::make_unique<NearestGrid>(index.codebook, index.k, dim, rows.data(), kSample);
}

void search_all(const NearestIndex& index, const NearestJob& job, size_t n, int threads) {
  // Where there are few codewords to look at, a piece of this many points would be done before
  // another thread has begun.
  constexpr size_t kMinGrain = 1024;
  constexpr size_t kMinWork = size_t{1} << 18;
  const size_t per_point = index.dim * std::min<size_t>(index.k, 64);
  const size_t grain = std::max(kMinGrain, kMinWork / per_point);
  const std::unique_ptr<NearestGrid> grid = grid_if_faster(index, job, n);
  parallel_for(threads, n, grain, [&](size_t begin, size_t end) {
    if (grid != nullptr) {
      search_grid(*grid, job, begin, end);
    } else {
      HWY_DYNAMIC_DISPATCH(search_range)(index, job, begin, end);
    }
  });
}

}  // namespace

void assign_nearest(const float* points, size_t n, size_t dim, const float* codebook, size_t k,
                    const NearestBackend& backend, const uint32_t* hint, uint32_t* labels,
                    float* sq_dist, Axes axes) {
  if (n == 0) return;
  if (backend.device != nullptr && backend.device->search({points, n, dim, codebook, k, 0, false,
                                                           labels, sq_dist, backend.held})) {
    return;
  }
  const NearestIndex index(codebook, k, dim, axes == Axes::kAny && worth_rotating(n, k, dim));
  search_all(index, {points, hint, 0, labels, sq_dist, false}, n, backend.threads);
}

void update_nearest(const float* points, size_t n, size_t dim, const float* codebook, size_t k,
                    uint32_t first_label, const NearestBackend& backend, uint32_t* labels,
                    float* sq_dist) {
  if (n == 0 || k == 0) return;
  if (backend.device != nullptr && backend.device->search({points, n, dim, codebook, k, first_label,
                                                           true, labels, sq_dist, backend.held})) {
    return;
  }
  const NearestIndex index(codebook, k, dim, false);
  search_all(index, {points, nullptr, first_label, labels, sq_dist, true}, n, backend.threads);
}

}  // namespace l4d
#endif  // HWY_ONCE
