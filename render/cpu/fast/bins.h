// SPDX-License-Identifier: Apache-2.0
// From splats in any order to a list per tile, front to back.
#pragma once

#include <cstdint>
#include <vector>

#include "libl4dcodec/base/memory.h"
#include "libl4dcodec/base/status.h"
#include "render/cpu/fast/kernels.h"

namespace l4d::render {

// Sorts splats by depth, nearer first; equal depths keep their order. Memory is kept between calls.
class DepthSort {
 public:
  // `splats` comes in parts of kPart places, of which the first counts[p] are taken. Fills `sorted`
  // with them all. Fails with LIMIT_EXCEEDED.
  static constexpr size_t kPart = 4096;
  Status sort(const FastSplat* splats, const std::vector<size_t>& counts, int threads,
              MemoryBudget& memory, std::vector<FastSplat>* sorted);
  void forget(MemoryBudget& memory);

 private:
  struct Key {
    uint32_t depth;  // bits of a positive float: they order as it does
    uint32_t place;
  };
  std::vector<Key> keys_, other_;
  std::vector<uint32_t> digits_;
};

// Tiles of the image that are worked on together: whole rows of tiles, or a part of one row.
struct Band {
  int row_begin, row_end, column_begin, column_end;
  int columns() const { return column_end - column_begin; }
  size_t tiles() const {
    return static_cast<size_t>(columns()) * static_cast<size_t>(row_end - row_begin);
  }
};

// Which splats touch which tiles: a tile is touched where the ellipse in which the splat shows
// meets the rectangle of the tile's pixel centres. No tile is missed; a few more are listed where
// the ellipse is cut by the border of the image, and by rounding.
//
// Lists are made band by band: a few splats that each cover the image are as many pairs of splat
// and tile as there are tiles. What a tile's list holds does not depend on the band.
class TileBins {
 public:
  // The splats stay the caller's, unchanged while their lists are asked for.
  Status start(const std::vector<FastSplat>& splats, int width, int height, int threads,
               MemoryBudget& memory);
  Band whole() const { return {0, rows_, 0, columns_}; }
  // Cuts the image into bands, from top to bottom and from left to right, none of which takes more
  // than `bytes`, or one tile where that is more. pair_bytes: what the caller keeps for each pair,
  // besides the lists. Fails with LIMIT_EXCEEDED where a tile alone does not fit in `memory`.
  Status cut(uint64_t bytes, uint64_t pair_bytes, bool with_places, MemoryBudget& memory,
             std::vector<Band>* out) const;
  // The lists of a band. with_places: also fills what place() and emitted() tell.
  Status build(const std::vector<FastSplat>& splats, const Band& band, bool with_places,
               int threads, MemoryBudget& memory);
  // Gives back what lists take, or all of it.
  void forget_lists(MemoryBudget& memory);
  void forget(MemoryBudget& memory);

  int columns() const { return columns_; }  // of the image
  int rows() const { return rows_; }
  // Of the band; tiles count from its first one, row by row.
  size_t instances() const { return list_.size(); }
  const uint32_t* list(size_t tile) const { return list_.data() + first_[tile]; }
  size_t first(size_t tile) const { return first_[tile]; }
  size_t count(size_t tile) const { return first_[tile + 1] - first_[tile]; }
  // Places in the lists of all tiles that hold splat i: place(emitted(i)), ..., place(emitted(i +
  // 1) - 1), by rising tile.
  size_t emitted(size_t splat) const { return emitted_[splat]; }
  uint32_t place(size_t emission) const { return place_[emission]; }

 private:
  struct Box {  // tiles that the splat's box meets
    uint16_t row_begin, row_end, column_begin, column_end;
  };
  struct Span {  // tiles of one row of tiles
    uint16_t row, begin, end;
  };
  // At most so many spans and pairs of splat and tile: those of boxes.
  struct Bound {
    uint64_t spans = 0, pairs = 0;
  };
  uint64_t bytes_of(const Bound& bound, uint64_t tiles, uint64_t pair_bytes) const;
  std::vector<Bound> bounds_of_rows() const;
  std::vector<Bound> bounds_of_columns(int row) const;
  Status cut_row(int row, uint64_t bytes, uint64_t pair_bytes, MemoryBudget& memory,
                 std::vector<Band>* out) const;
  size_t bound_spans(const Band& band, size_t first, size_t last) const;
  // The tiles of the band's row that splat i touches; an empty range where there are none.
  Span span_of(const FastSplat& splat, const Box& box, int row, const Band& band) const;
  Status charge_memory(const Band& band, bool with_places, int threads, MemoryBudget& memory);
  Status place_lists(const Band& band, bool with_places, MemoryBudget& memory);

  int columns_ = 0, rows_ = 0;
  Bound bound_;             // of the whole image
  std::vector<Box> boxes_;  // [splats]
  std::vector<uint32_t> list_;
  std::vector<size_t> first_;    // [tiles + 1]
  std::vector<size_t> emitted_;  // [splats + 1]
  std::vector<uint32_t> place_;
  // Pieces of the splats work on their own.
  std::vector<Span> spans_;         // room for those of each piece, from first_span_ on
  std::vector<size_t> first_span_;  // [pieces + 1]
  std::vector<uint32_t> next_;      // [pieces, tiles] counts, then where to write
  std::vector<uint16_t> spans_of_;  // [splats] number of spans
};

}  // namespace l4d::render
