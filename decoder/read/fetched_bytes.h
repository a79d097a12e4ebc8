// SPDX-License-Identifier: Apache-2.0
// Bytes of a file that were read before anyone wanted them, because reads cost more than bytes.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "l4d/decode.h"
#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/memory.h"

namespace l4d {

struct ByteRange {
  uint64_t offset = 0, size = 0;  // in the file
};

// What bytes were fetched for, which says how long they stay.
enum class FetchedFor {
  kStream,     // headers, tables and codebooks: while the stream is open
  kPageTable,  // entries of page tables of an instant, until the next ones are fetched
  kDirectory,  // directory pages of an instant, likewise
  kPages,      // pages of an instant or of a second, likewise
  kBase,       // base chunks, as SH chunks may be wanted later; the last 32 MiB of them
};

class FetchedBytes {
 public:
  // The bytes [offset, offset + n), if one block holds them all. They stay until the block goes.
  bool find(uint64_t offset, uint64_t n, ByteSpan* out) const;

  // Drops blocks of `reason` that hold none of `wanted`.
  void keep_only(FetchedFor reason, const std::vector<ByteRange>& wanted);
  // Drops the oldest blocks of `reason` while all of them take more than `bytes`.
  void limit(FetchedFor reason, uint64_t bytes);
  void clear() { blocks_.clear(); }

  // Charges a block. Returns its bytes, to be filled, or null if the budget does not hold them
  // together with three times as many for their users.
  unsigned char* add(uint64_t offset, uint64_t n, FetchedFor reason, MemoryBudget& memory);
  void remove(uint64_t offset) { blocks_.erase(offset); }

 private:
  struct Block {
    Block(uint64_t n, FetchedFor why, uint64_t when, MemoryBudget& budget)
        : bytes(static_cast<size_t>(n)), reason(why), number(when), memory(budget) {}
    Bytes bytes;
    FetchedFor reason;
    uint64_t number;
    MemoryCharge memory;
  };
  using Blocks = std::map<uint64_t, std::unique_ptr<Block>>;  // by offset
  Blocks::const_iterator block_with(uint64_t offset, uint64_t n) const;

  Blocks blocks_;
  uint64_t numbered_ = 0;
};

}  // namespace l4d
