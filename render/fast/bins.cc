// SPDX-License-Identifier: Apache-2.0
#include "render/fast/bins.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "libl4dcodec/base/threads.h"

namespace l4d::render {
namespace {

constexpr size_t kGrain = 16384;
constexpr size_t kPrefetch = 16;  // splats ahead
constexpr int kRadixBits = 11;
constexpr size_t kRadix = size_t{1} << kRadixBits;

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
  const float level = kLog2MinAlpha - s.log2_opacity;  // a x^2 + 2 b x y + c y^2 >= level
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

void DepthSort::sort(const FastSplat* splats, const std::vector<size_t>& counts, int threads,
                     std::vector<FastSplat>* sorted) {
  std::vector<size_t> begin(counts.size() + 1, 0);
  for (size_t p = 0; p < counts.size(); ++p) begin[p + 1] = begin[p] + counts[p];
  const size_t n = begin.back();
  keys_.resize(n);
  other_.resize(n);
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
  const size_t pieces = (n + kGrain - 1) / kGrain;
  std::vector<uint32_t> digits(pieces * kRadix);
  for (int shift = 0; shift < 32; shift += kRadixBits) {
    std::fill(digits.begin(), digits.end(), 0);
    parallel_for(threads, n, kGrain, [&](size_t first, size_t last) {
      uint32_t* count = digits.data() + first / kGrain * kRadix;
      for (size_t i = first; i < last; ++i) ++count[keys_[i].depth >> shift & (kRadix - 1)];
    });
    uint32_t at = 0;
    for (size_t digit = 0; digit < kRadix; ++digit) {
      for (size_t p = 0; p < pieces; ++p) {
        uint32_t& count = digits[p * kRadix + digit];
        const uint32_t here = count;
        count = at;
        at += here;
      }
    }
    parallel_for(threads, n, kGrain, [&](size_t first, size_t last) {
      uint32_t* next = digits.data() + first / kGrain * kRadix;
      for (size_t i = first; i < last; ++i) {
        other_[next[keys_[i].depth >> shift & (kRadix - 1)]++] = keys_[i];
      }
    });
    keys_.swap(other_);
  }
  sorted->resize(n);
  parallel_for(threads, n, kGrain, [&](size_t first, size_t last) {
    for (size_t i = first; i < last; ++i) {
      prefetch(splats + keys_[std::min(i + kPrefetch, last - 1)].place);
      (*sorted)[i] = splats[keys_[i].place];
    }
  });
}

void TileBins::build(const std::vector<FastSplat>& splats, int width, int height, bool with_places,
                     int threads) {
  columns_ = (width + kTile - 1) / kTile;
  rows_ = (height + kTile - 1) / kTile;
  const size_t tiles = static_cast<size_t>(columns_) * static_cast<size_t>(rows_);
  const size_t n = splats.size();
  const size_t pieces = (n + kGrain - 1) / kGrain;
  spans_.resize(pieces);
  next_.resize(pieces);
  spans_of_.resize(pieces);
  emitted_.assign(with_places ? n + 1 : 0, 0);
  parallel_for(threads, n, kGrain, [&](size_t first, size_t last) {
    const size_t piece = first / kGrain;
    std::vector<Span>& spans = spans_[piece];
    std::vector<uint32_t>& counts = next_[piece];
    spans.clear();
    spans_of_[piece].assign(last - first, 0);
    counts.assign(tiles, 0);
    for (size_t i = first; i < last; ++i) {
      const FastSplat& s = splats[i];
      const TileRange rows = tiles_between(s.mean[1] - s.extent[1], s.mean[1] + s.extent[1], rows_);
      const TileRange all =
          tiles_between(s.mean[0] - s.extent[0], s.mean[0] + s.extent[0], columns_);
      size_t emitted = 0;
      for (int row = rows.begin; row < rows.end; ++row) {
        TileRange range = all;
        // One row or column of tiles: the box is as good as the ellipse.
        if (rows.end - rows.begin > 1 && all.end - all.begin > 1) {
          const float top = static_cast<float>(row * kTile) + 0.5f - s.mean[1];
          float left = 0, right = 0;
          if (!reach_of_rows(s, top, top + static_cast<float>(kTile - 1), &left, &right)) continue;
          range = tiles_between(s.mean[0] + left, s.mean[0] + right, columns_);
        }
        if (range.begin >= range.end) continue;
        spans.push_back({static_cast<uint16_t>(row), static_cast<uint16_t>(range.begin),
                         static_cast<uint16_t>(range.end)});
        ++spans_of_[piece][i - first];
        uint32_t* row_counts = counts.data() + static_cast<size_t>(row * columns_);
        for (int x = range.begin; x < range.end; ++x) ++row_counts[x];
        emitted += static_cast<size_t>(range.end - range.begin);
      }
      if (with_places) emitted_[i + 1] = emitted;
    }
  });
  for (size_t i = 1; i < emitted_.size(); ++i) emitted_[i] += emitted_[i - 1];
  first_.resize(tiles + 1);
  size_t at = 0;
  for (size_t tile = 0; tile < tiles; ++tile) {
    first_[tile] = at;
    for (size_t p = 0; p < pieces; ++p) {
      const uint32_t here = next_[p][tile];
      next_[p][tile] = static_cast<uint32_t>(at);
      at += here;
    }
  }
  first_[tiles] = at;
  list_.resize(at);
  place_.resize(with_places ? at : 0);
  parallel_for(threads, n, kGrain, [&](size_t first, size_t last) {
    const size_t piece = first / kGrain;
    uint32_t* next = next_[piece].data();
    const Span* span = spans_[piece].data();
    uint32_t* places = with_places ? place_.data() + emitted_[first] : nullptr;
    for (size_t i = first; i < last; ++i) {
      for (uint32_t k = 0; k < spans_of_[piece][i - first]; ++k, ++span) {
        const size_t row = static_cast<size_t>(span->row) * static_cast<size_t>(columns_);
        for (size_t x = span->begin; x < span->end; ++x) {
          const uint32_t place = next[row + x]++;
          list_[place] = static_cast<uint32_t>(i);
          if (places != nullptr) *places++ = place;
        }
      }
    }
  });
}

}  // namespace l4d::render
