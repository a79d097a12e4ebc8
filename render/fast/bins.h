// SPDX-License-Identifier: Apache-2.0
// From splats in any order to a list per tile, front to back.
#pragma once

#include <cstdint>
#include <vector>

#include "render/fast/kernels.h"

namespace l4d::render {

// Sorts splats by depth, nearer first; equal depths keep their order. Memory is kept between calls.
class DepthSort {
 public:
  // `splats` comes in parts of kPart places, of which the first counts[p] are taken. Fills `sorted`
  // with them all.
  static constexpr size_t kPart = 4096;
  void sort(const FastSplat* splats, const std::vector<size_t>& counts, int threads,
            std::vector<FastSplat>* sorted);

 private:
  struct Key {
    uint32_t depth;  // bits of a positive float: they order as it does
    uint32_t place;
  };
  std::vector<Key> keys_, other_;
};

// Which splats touch which tiles: a tile is touched where the ellipse in which the splat's alpha
// reaches kMinAlpha meets the rectangle of the tile's pixel centres. No tile is missed; a few more
// are listed where the ellipse is cut by the border of the image, and by rounding.
class TileBins {
 public:
  // with_places: also fills what place() and emitted() tell.
  void build(const std::vector<FastSplat>& splats, int width, int height, bool with_places,
             int threads);

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  size_t instances() const { return list_.size(); }
  const uint32_t* list(size_t tile) const { return list_.data() + first_[tile]; }
  size_t first(size_t tile) const { return first_[tile]; }
  size_t count(size_t tile) const { return first_[tile + 1] - first_[tile]; }
  // Places in the lists of all tiles that hold splat i: place(emitted(i)), ..., place(emitted(i +
  // 1) - 1).
  size_t emitted(size_t splat) const { return emitted_[splat]; }
  uint32_t place(size_t emission) const { return place_[emission]; }

 private:
  struct Span {  // tiles of one row of tiles
    uint16_t row, begin, end;
  };
  int columns_ = 0, rows_ = 0;
  std::vector<uint32_t> list_;
  std::vector<size_t> first_;    // [tiles + 1]
  std::vector<size_t> emitted_;  // [splats + 1]
  std::vector<uint32_t> place_;
  std::vector<std::vector<Span>> spans_;     // of each piece of the splats
  std::vector<std::vector<uint32_t>> next_;  // of each piece: [tiles] counts, then where to write
  std::vector<std::vector<uint16_t>> spans_of_;  // of each piece: number of spans of each splat
};

}  // namespace l4d::render
