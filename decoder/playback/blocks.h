// SPDX-License-Identifier: Apache-2.0
// Received bytes of a file, in blocks of 4 KiB. All steps take the time of the blocks that they
// touch: finding, appending, using and evicting do not depend on how many are held.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "decoder/playback/slots.h"
#include "libl4dcodec/base/bytes.h"

namespace l4d::playback {

class Blocks {
 public:
  static constexpr uint64_t kBlockBytes = 4096;
  static constexpr uint64_t kSlabBytes = uint64_t{1} << 20;

  // max_bytes: of slabs; at least one is allowed.
  explicit Blocks(uint64_t max_bytes) { set_limit(max_bytes); }
  void set_limit(uint64_t max_bytes);
  uint64_t capacity_bytes() const { return max_slabs_ * kSlabBytes; }

  // Bytes are valid in the prefix of each block. Copies what extends one, from the front, and skips
  // what is held. Returns how many bytes of `data` are held then: fewer than all of them where a
  // block has a gap before the data, or where no block can be evicted.
  uint64_t append(uint64_t offset, ByteSpan data);
  // Replaces bytes where they are held.
  void overwrite(uint64_t offset, ByteSpan data);
  // The first byte of [offset, end) that is not held; `end` where all are.
  uint64_t gap_begin(uint64_t offset, uint64_t end) const;
  // Where the gap that begins at `offset` ends: at a block that holds something, or at `end`.
  uint64_t gap_end(uint64_t offset, uint64_t end) const;
  // The end of the valid prefix of the block that `offset` is in.
  uint64_t fill_mark(uint64_t offset) const;
  // Copies bytes that are held.
  void read(uint64_t offset, uint64_t n, unsigned char* to) const;

  // Blocks of the present epoch are not evicted. Those that are appended to belong to it.
  void begin_epoch() { ++epoch_; }
  void use(uint64_t offset, uint64_t n);
  // Whether the next block needs the place of another one.
  bool is_full() const { return !slots_.has_free() && slabs_.size() >= max_slabs_; }

  void clear();
  uint64_t memory_bytes() const;
  uint64_t num_blocks() const { return slots_.size(); }
  uint64_t num_evicted() const { return num_evicted_; }
  uint64_t num_stored() const { return num_stored_; }  // bytes that were ever copied

 private:
  static constexpr uint32_t kNone = Slots::kNone;
  static constexpr uint32_t kPerSlab = static_cast<uint32_t>(kSlabBytes / kBlockBytes);
  struct Block {
    uint32_t fill = 0;  // bytes of the valid prefix
    uint32_t epoch = 0;
  };

  unsigned char* bytes_of(uint32_t slot) const {
    return slabs_[slot / kPerSlab].get() + uint64_t{slot % kPerSlab} * kBlockBytes;
  }
  uint32_t make(uint64_t number);  // kNone where nothing can be evicted
  bool add_slab();
  bool evict();

  uint64_t max_slabs_ = 1;
  std::vector<std::unique_ptr<unsigned char[]>> slabs_;
  Slots slots_;                // by the number of the block in the file
  std::vector<Block> blocks_;  // by slot
  uint32_t epoch_ = 1;
  uint64_t num_evicted_ = 0, num_stored_ = 0;
};

// The blocks of one of the files that share a pool: its bytes are those from `base` on.
class FileBlocks {
 public:
  static constexpr uint64_t kMostBytes = uint64_t{1} << 40;  // of a file

  // number: below 2^24, of the file.
  FileBlocks(Blocks& pool, uint32_t number) : pool_(pool) { set_number(number); }
  void set_number(uint32_t number) { base_ = number * kMostBytes; }
  uint64_t append(uint64_t offset, ByteSpan data) { return pool_.append(base_ + offset, data); }
  void overwrite(uint64_t offset, ByteSpan data) { pool_.overwrite(base_ + offset, data); }
  uint64_t gap_begin(uint64_t offset, uint64_t end) const {
    return pool_.gap_begin(base_ + offset, base_ + end) - base_;
  }
  uint64_t gap_end(uint64_t offset, uint64_t end) const {
    return pool_.gap_end(base_ + offset, base_ + end) - base_;
  }
  uint64_t fill_mark(uint64_t offset) const { return pool_.fill_mark(base_ + offset) - base_; }
  void read(uint64_t offset, uint64_t n, unsigned char* to) const {
    pool_.read(base_ + offset, n, to);
  }
  void use(uint64_t offset, uint64_t n) { pool_.use(base_ + offset, n); }

 private:
  Blocks& pool_;
  uint64_t base_ = 0;
};

}  // namespace l4d::playback
