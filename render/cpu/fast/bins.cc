// SPDX-License-Identifier: Apache-2.0
#include "render/cpu/fast/bins.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "libl4dcodec/base/threads.h"

namespace l4d::render {
namespace {

constexpr size_t kBinGrain = size_t{1} << 14;
constexpr size_t kPrefetch = 16;  // splats ahead
constexpr int kRadixBits = 11;
constexpr size_t kRadix = size_t{1} << kRadixBits;
constexpr const char* kLists = "lists of splats by tile";

size_t pieces_of(size_t splats) { return (splats + kBinGrain - 1) / kBinGrain; }

inline void prefetch(const void* address) {
#if defined(__GNUC__)
  __builtin_prefetch(address);
#else
  (void)address;
#endif
}

// The interval of x in which the splat reaches the rows of pixel centres [top, bottom], relative to
// the mean; false where it reaches none.
bool reach_of_rows(const FastSplat& s, float top, float bottom, float* left, float* right) {
  if (bottom < -s.extent[1] || top > s.extent[1]) return false;
  const float a = s.conic[0], b = 0.5f * s.conic[1], c = s.conic[2];  // negative definite
  const float level = s.log2_least - s.log2_opacity;  // a x^2 + 2 b x y + c y^2 >= level
  // Where the ellipse is widest: x = +-extent[0] at y = -+extent[0] b / c.
  const float y_at_right = -s.extent[0] * b / c;
  const auto edge = [&](float y, float sign) {
    const float half2 = b * y * b * y - a * (c * y * y - level);
    return (-b * y - sign * std::sqrt(std::max(half2, 0.0f))) / a;
  };
  const auto clamped = [&](float y) { return std::min(std::max(y, top), bottom); };
  const float at_right = clamped(y_at_right), at_left = clamped(-y_at_right);
  *right = at_right == y_at_right ? s.extent[0] : edge(at_right, 1.0f);
  *left = at_left == -y_at_right ? -s.extent[0] : edge(at_left, -1.0f);
  return true;
}

// Tiles that hold pixel centres of [low, high].
struct TileRange {
  int begin, end;
};
inline TileRange tiles_between(float low, float high, int tiles) {
  // A hair wider, for rounding. Clamped while still floating; what is not negative, truncation
  // rounds down.
  constexpr float kSlack = 1e-3f;
  constexpr float kPerTile = 1.0f / kTile;
  const float limit = static_cast<float>(tiles);
  const float first = (low - 0.5f - kSlack) * kPerTile;
  const float last = (high - 0.5f + kSlack) * kPerTile;
  if (!(last >= 0) || !(first < limit)) return {0, 0};
  // A tile's last pixel centre lies 1/16 tile before the next tile's first: low rounds up to a
  // pixel.
  const float pixel = std::max(low - 0.5f - kSlack, 0.0f);
  int first_pixel = static_cast<int>(std::min(pixel, limit * kTile));
  first_pixel += static_cast<float>(first_pixel) < pixel;
  return {std::min(first_pixel / kTile, tiles), static_cast<int>(std::min(last, limit - 1)) + 1};
}

}  // namespace

Status DepthSort::sort(const FastSplat* splats, const std::vector<size_t>& counts, int threads,
                       MemoryBudget& memory, std::vector<FastSplat>* sorted) {
  std::vector<size_t> begin(counts.size() + 1, 0);
  for (size_t p = 0; p < counts.size(); ++p) begin[p + 1] = begin[p] + counts[p];
  const size_t n = begin.back();
  const size_t pieces = pieces_of(n);
  constexpr const char* kWhat = "sorting splats";
  L4D_RETURN_IF_ERROR(renew(memory, &keys_, n, kWhat));
  L4D_RETURN_IF_ERROR(renew(memory, &other_, n, kWhat));
  L4D_RETURN_IF_ERROR(renew(memory, &digits_, pieces * kRadix, kWhat));
  L4D_RETURN_IF_ERROR(renew(memory, sorted, n, kWhat));
  parallel_for(threads, counts.size(), 4, [&](size_t first, size_t last) {
    for (size_t p = first; p < last; ++p) {
      for (size_t i = 0; i < counts[p]; ++i) {
        Key& key = keys_[begin[p] + i];
        key.place = static_cast<uint32_t>(kPart * p + i);
        std::memcpy(&key.depth, &splats[key.place].depth, sizeof(float));
      }
    }
  });
  // Least significant digit first; pieces of fixed size count and scatter on their own.
  for (int shift = 0; shift < 32; shift += kRadixBits) {
    std::fill(digits_.begin(), digits_.end(), 0);
    parallel_for(threads, n, kBinGrain, [&](size_t first, size_t last) {
      uint32_t* count = digits_.data() + first / kBinGrain * kRadix;
      for (size_t i = first; i < last; ++i) ++count[keys_[i].depth >> shift & (kRadix - 1)];
    });
    uint32_t at = 0;
    for (size_t digit = 0; digit < kRadix; ++digit) {
      for (size_t p = 0; p < pieces; ++p) {
        uint32_t& count = digits_[p * kRadix + digit];
        const uint32_t here = count;
        count = at;
        at += here;
      }
    }
    parallel_for(threads, n, kBinGrain, [&](size_t first, size_t last) {
      uint32_t* next = digits_.data() + first / kBinGrain * kRadix;
      for (size_t i = first; i < last; ++i) {
        other_[next[keys_[i].depth >> shift & (kRadix - 1)]++] = keys_[i];
      }
    });
    keys_.swap(other_);
  }
  parallel_for(threads, n, kBinGrain, [&](size_t first, size_t last) {
    for (size_t i = first; i < last; ++i) {
      prefetch(splats + keys_[std::min(i + kPrefetch, last - 1)].place);
      (*sorted)[i] = splats[keys_[i].place];
    }
  });
  return {};
}

void DepthSort::forget(MemoryBudget& memory) {
  l4d::forget(memory, &keys_);
  l4d::forget(memory, &other_);
  l4d::forget(memory, &digits_);
}

Status TileBins::start(const std::vector<FastSplat>& splats, int width, int height, int threads,
                       MemoryBudget& memory) {
  columns_ = (width + kTile - 1) / kTile;
  rows_ = (height + kTile - 1) / kTile;
  const size_t n = splats.size();
  L4D_RETURN_IF_ERROR(renew(memory, &boxes_, n, "boxes of splats"));
  std::vector<Bound> bounds(pieces_of(n));
  parallel_for(threads, n, kBinGrain, [&](size_t first, size_t last) {
    Bound& bound = bounds[first / kBinGrain];
    for (size_t i = first; i < last; ++i) {
      const FastSplat& s = splats[i];
      const TileRange rows = tiles_between(s.mean[1] - s.extent[1], s.mean[1] + s.extent[1], rows_);
      const TileRange columns =
          tiles_between(s.mean[0] - s.extent[0], s.mean[0] + s.extent[0], columns_);
      const int height_of = std::max(rows.end - rows.begin, 0);
      const int width_of = std::max(columns.end - columns.begin, 0);
      boxes_[i] = {static_cast<uint16_t>(rows.begin), static_cast<uint16_t>(rows.end),
                   static_cast<uint16_t>(columns.begin), static_cast<uint16_t>(columns.end)};
      bound.spans += static_cast<uint64_t>(height_of);
      bound.pairs += static_cast<uint64_t>(height_of) * static_cast<uint64_t>(width_of);
    }
  });
  bound_ = {};
  for (const Bound& b : bounds) {
    bound_.spans += b.spans;
    bound_.pairs += b.pairs;
  }
  return {};
}

uint64_t TileBins::bytes_of(const Bound& bound, uint64_t tiles, uint64_t pair_bytes) const {
  const uint64_t per_tile = pieces_of(boxes_.size()) * sizeof(uint32_t) + sizeof(size_t);
  return bound.pairs * pair_bytes + bound.spans * sizeof(Span) + tiles * per_tile;
}

// Counts what begins and ends at each row, then adds up.
std::vector<TileBins::Bound> TileBins::bounds_of_rows() const {
  std::vector<Bound> rows(static_cast<size_t>(rows_) + 1);
  for (const Box& box : boxes_) {
    if (box.row_begin >= box.row_end || box.column_begin >= box.column_end) continue;
    const uint64_t width = static_cast<uint64_t>(box.column_end - box.column_begin);
    Bound& begin = rows[box.row_begin];
    Bound& end = rows[box.row_end];
    ++begin.spans;
    begin.pairs += width;
    --end.spans;  // sums wrap and come back
    end.pairs -= width;
  }
  for (size_t r = 1; r < rows.size(); ++r) {
    rows[r].spans += rows[r - 1].spans;
    rows[r].pairs += rows[r - 1].pairs;
  }
  rows.pop_back();
  return rows;
}

std::vector<TileBins::Bound> TileBins::bounds_of_columns(int row) const {
  std::vector<Bound> columns(static_cast<size_t>(columns_) + 1);
  for (const Box& box : boxes_) {
    if (row < box.row_begin || row >= box.row_end || box.column_begin >= box.column_end) continue;
    ++columns[box.column_begin].pairs;
    --columns[box.column_end].pairs;
  }
  for (size_t c = 1; c < columns.size(); ++c) columns[c].pairs += columns[c - 1].pairs;
  columns.pop_back();
  for (Bound& column : columns) column.spans = column.pairs;
  return columns;
}

Status TileBins::cut(uint64_t bytes, uint64_t pair_bytes, bool with_places, MemoryBudget& memory,
                     std::vector<Band>* out) const {
  out->clear();
  pair_bytes += (with_places ? 2 : 1) * sizeof(uint32_t);
  const uint64_t columns = static_cast<uint64_t>(columns_);
  if (bytes_of(bound_, columns * static_cast<uint64_t>(rows_), pair_bytes) <= bytes) {
    out->push_back(whole());
    return {};
  }
  const std::vector<Bound> bounds = bounds_of_rows();
  Bound sum;
  int begin = 0;
  const auto flush = [&](int end) {
    if (end > begin) out->push_back({begin, end, 0, columns_});
    begin = end;
    sum = {};
  };
  for (int row = 0; row < rows_; ++row) {
    const Bound& here = bounds[static_cast<size_t>(row)];
    Bound with{sum.spans + here.spans, sum.pairs + here.pairs};
    const uint64_t tiles = columns * static_cast<uint64_t>(row + 1 - begin);
    if (bytes_of(with, tiles, pair_bytes) > bytes) {
      flush(row);
      with = here;
      if (bytes_of(here, columns, pair_bytes) > bytes) {
        L4D_RETURN_IF_ERROR(cut_row(row, bytes, pair_bytes, memory, out));
        begin = row + 1;
        continue;
      }
    }
    sum = with;
  }
  flush(rows_);
  return {};
}

Status TileBins::cut_row(int row, uint64_t bytes, uint64_t pair_bytes, MemoryBudget& memory,
                         std::vector<Band>* out) const {
  const std::vector<Bound> bounds = bounds_of_columns(row);
  Bound sum;
  int begin = 0;
  for (int column = 0; column < columns_; ++column) {
    const Bound& here = bounds[static_cast<size_t>(column)];
    Bound with{sum.spans + here.spans, sum.pairs + here.pairs};
    const uint64_t tiles = static_cast<uint64_t>(column + 1 - begin);
    if (column > begin && bytes_of(with, tiles, pair_bytes) > bytes) {
      out->push_back({row, row + 1, begin, column});
      begin = column;
      with = here;
    }
    L4D_RETURN_IF_ERROR(memory.check(bytes_of(here, 1, pair_bytes), "the splats of one tile"));
    sum = with;
  }
  out->push_back({row, row + 1, begin, columns_});
  return {};
}

size_t TileBins::bound_spans(const Band& band, size_t first, size_t last) const {
  size_t spans = 0;
  for (size_t i = first; i < last; ++i) {
    const Box& box = boxes_[i];
    const int rows =
        std::min<int>(box.row_end, band.row_end) - std::max<int>(box.row_begin, band.row_begin);
    const bool meets = box.column_begin < band.column_end && box.column_end > band.column_begin;
    if (rows > 0 && meets) spans += static_cast<size_t>(rows);
  }
  return spans;
}

TileBins::Span TileBins::span_of(const FastSplat& s, const Box& box, int row,
                                 const Band& band) const {
  TileRange range{box.column_begin, box.column_end};
  // One row or column of tiles: the box is as good as the ellipse.
  if (box.row_end - box.row_begin > 1 && box.column_end - box.column_begin > 1) {
    const float top = static_cast<float>(row * kTile) + 0.5f - s.mean[1];
    float left = 0, right = 0;
    if (!reach_of_rows(s, top, top + static_cast<float>(kTile - 1), &left, &right)) return {};
    range = tiles_between(s.mean[0] + left, s.mean[0] + right, columns_);
  }
  const int begin = std::max(range.begin, band.column_begin);
  const int end = std::max(begin, std::min(range.end, band.column_end));
  return {static_cast<uint16_t>(row), static_cast<uint16_t>(begin), static_cast<uint16_t>(end)};
}

// Room for what pieces write each on their own.
Status TileBins::charge_memory(const Band& band, bool with_places, int threads,
                               MemoryBudget& memory) {
  const size_t n = boxes_.size(), pieces = pieces_of(n);
  L4D_RETURN_IF_ERROR(renew(memory, &first_span_, pieces + 1, kLists));
  first_span_[0] = 0;
  parallel_for(threads, n, kBinGrain, [&](size_t first, size_t last) {
    first_span_[first / kBinGrain + 1] = bound_spans(band, first, last);
  });
  for (size_t p = 0; p < pieces; ++p) first_span_[p + 1] += first_span_[p];
  L4D_RETURN_IF_ERROR(renew(memory, &spans_, first_span_[pieces], kLists));
  L4D_RETURN_IF_ERROR(renew(memory, &next_, pieces * band.tiles(), kLists));
  L4D_RETURN_IF_ERROR(renew(memory, &spans_of_, n, kLists));
  return renew(memory, &emitted_, with_places ? n + 1 : 0, kLists);
}

// From counts to places in the lists.
Status TileBins::place_lists(const Band& band, bool with_places, MemoryBudget& memory) {
  const size_t tiles = band.tiles(), pieces = pieces_of(boxes_.size());
  for (size_t i = 1; i < emitted_.size(); ++i) emitted_[i] += emitted_[i - 1];
  L4D_RETURN_IF_ERROR(renew(memory, &first_, tiles + 1, kLists));
  size_t at = 0;
  for (size_t tile = 0; tile < tiles; ++tile) {
    first_[tile] = at;
    for (size_t p = 0; p < pieces; ++p) {
      uint32_t& next = next_[p * tiles + tile];
      const uint32_t here = next;
      next = static_cast<uint32_t>(at);
      at += here;
    }
  }
  first_[tiles] = at;
  L4D_RETURN_IF_ERROR(renew(memory, &list_, at, kLists));
  return renew(memory, &place_, with_places ? at : 0, kLists);
}

Status TileBins::build(const std::vector<FastSplat>& splats, const Band& band, bool with_places,
                       int threads, MemoryBudget& memory) {
  const size_t n = splats.size(), tiles = band.tiles();
  const size_t columns = static_cast<size_t>(band.columns());
  // Of the band.
  const auto row_of = [&](int row) { return static_cast<size_t>(row - band.row_begin) * columns; };
  const auto column_of = [&](int column) {
    return static_cast<size_t>(column - band.column_begin);
  };
  L4D_RETURN_IF_ERROR(charge_memory(band, with_places, threads, memory));
  if (with_places) emitted_[0] = 0;
  parallel_for(threads, n, kBinGrain, [&](size_t first, size_t last) {
    const size_t piece = first / kBinGrain;
    Span* next_span = spans_.data() + first_span_[piece];
    uint32_t* counts = next_.data() + piece * tiles;
    std::fill_n(counts, tiles, 0u);
    for (size_t i = first; i < last; ++i) {
      const Box& box = boxes_[i];
      const int end = std::min<int>(box.row_end, band.row_end);
      const Span* const before = next_span;
      size_t emitted = 0;
      for (int row = std::max<int>(box.row_begin, band.row_begin); row < end; ++row) {
        if (box.column_begin >= band.column_end || box.column_end <= band.column_begin) break;
        const Span span = span_of(splats[i], box, row, band);
        if (span.begin >= span.end) continue;
        *next_span++ = span;
        uint32_t* row_counts = counts + row_of(row);
        for (size_t x = column_of(span.begin); x < column_of(span.end); ++x) ++row_counts[x];
        emitted += static_cast<size_t>(span.end - span.begin);
      }
      spans_of_[i] = static_cast<uint16_t>(next_span - before);
      if (with_places) emitted_[i + 1] = emitted;
    }
  });
  L4D_RETURN_IF_ERROR(place_lists(band, with_places, memory));
  parallel_for(threads, n, kBinGrain, [&](size_t first, size_t last) {
    const size_t piece = first / kBinGrain;
    uint32_t* next = next_.data() + piece * tiles;
    const Span* span = spans_.data() + first_span_[piece];
    uint32_t* places = with_places ? place_.data() + emitted_[first] : nullptr;
    for (size_t i = first; i < last; ++i) {
      for (uint32_t k = 0; k < spans_of_[i]; ++k, ++span) {
        const size_t row = row_of(span->row);
        for (size_t x = column_of(span->begin); x < column_of(span->end); ++x) {
          const uint32_t place = next[row + x]++;
          list_[place] = static_cast<uint32_t>(i);
          if (places != nullptr) *places++ = place;
        }
      }
    }
  });
  return {};
}

void TileBins::forget_lists(MemoryBudget& memory) {
  l4d::forget(memory, &list_);
  l4d::forget(memory, &first_);
  l4d::forget(memory, &place_);
  l4d::forget(memory, &spans_);
  l4d::forget(memory, &next_);
}

void TileBins::forget(MemoryBudget& memory) {
  forget_lists(memory);
  l4d::forget(memory, &boxes_);
  l4d::forget(memory, &emitted_);
  l4d::forget(memory, &first_span_);
  l4d::forget(memory, &spans_of_);
}

}  // namespace l4d::render
