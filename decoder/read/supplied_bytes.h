// SPDX-License-Identifier: Apache-2.0
// The bytes of a file that a caller has handed over, in any order and any pieces.
#pragma once

#include <cstdint>
#include <map>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/memory.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

class SuppliedBytes {
 public:
  // Copies what of [offset, offset + data.size()) is not here, and charges it to `memory`, which is
  // the same in every call. Fails with LIMIT_EXCEEDED, and then has copied none or some of it.
  Status add(uint64_t offset, ByteSpan data, MemoryBudget& memory);
  // Whether all of [offset, offset + n) is here.
  bool holds(uint64_t offset, uint64_t n) const;
  // The bytes of a range that is here: within one piece, or copied to `storage`.
  ByteSpan get(uint64_t offset, uint64_t n, Bytes& storage) const;
  void drop(uint64_t offset, uint64_t n, MemoryBudget& memory);
  // Drops what has been here longest, until `memory` has room for `n` bytes more or nothing is
  // left.
  void make_room(uint64_t n, MemoryBudget& memory);
  // Where the first byte at or after `offset` is that is not here.
  uint64_t gap_begin(uint64_t offset) const;

 private:
  // Pieces, by offset, do not overlap. Neighbours stay apart, so that nothing is copied twice.
  struct Piece {
    Bytes bytes;
    uint64_t number = 0;  // of supplies
  };
  using Pieces = std::map<uint64_t, Piece>;
  // The piece that holds the byte, or the next one.
  Pieces::const_iterator at_or_after(uint64_t offset) const;
  static uint64_t end_of(Pieces::const_iterator it) { return it->first + it->second.bytes.size(); }

  Pieces pieces_;
  uint64_t numbered_ = 0;
  static constexpr uint64_t kNodeBytes = 96;
};

}  // namespace l4d
