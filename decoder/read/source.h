// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <vector>

#include "decoder/read/fetched_bytes.h"
#include "decoder/read/supplied_bytes.h"
#include "l4d/decode.h"
#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/memory.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

// Neighbouring parts of a file are read in runs of no more than about this size.
constexpr uint64_t kMaxReadBytes = uint64_t{32} << 20;

// The bytes of a stream: host memory (no copy), a reader callback, or what a caller supplies when
// it has it. Counts what it reads.
class ByteSource {
 public:
  ByteSource() = default;
  static ByteSource from_memory(ByteSpan data);
  static Status from_reader(const l4d_reader& reader, ByteSource* out);
  // Of a file of `size` bytes, 0 if that is not known, of which none is here.
  static ByteSource from_supplies(uint64_t size);

  uint64_t size() const { return size_; }
  // Bytes behind the first `bytes` are not of the stream.
  void limit(uint64_t bytes) { size_ = std::min(size_, bytes); }
  // Bytes [offset, offset + n). The result aliases host memory, `storage`, or what was fetched, up
  // to the next fetch() or forget(). Fails with TRUNCATED (citing CHNK-1) where the range leaves
  // the file; nothing is allocated then.
  Status read(uint64_t offset, uint64_t n, Bytes& storage, ByteSpan* out);

  // How many bytes are worth one more read, 0 if reads cost nothing. Only then fetch() fetches.
  uint64_t block_bytes() const { return reader_.block_bytes; }
  bool fetches() const { return block_bytes() > 0; }
  // Reads ranges in few calls, so that read() needs none for any part of them. What was fetched
  // before stays as long as its reason says. What is held is not read again, what cannot be read or
  // does not fit into `memory` is left out: read() then says why.
  void fetch(std::vector<l4d_byte_range> ranges, FetchedFor reason, MemoryBudget& memory);
  // Whether read() needs no call.
  bool is_fetched(uint64_t offset, uint64_t n) const;
  // Drops what was fetched.
  void forget() { fetched_.clear(); }
  // What was read is wrong somewhere: the next query asks the reader again.
  void distrust() { trusted_ = false; }
  void begin_query() {
    if (!trusted_) forget();
    trusted_ = true;
  }

  // Of a source of supplies. Fails with INVALID_ARGUMENT where the range leaves the file.
  bool is_supplied() const { return is_supplied_; }
  Status supply(uint64_t offset, ByteSpan data, MemoryBudget& memory);
  bool holds(uint64_t offset, uint64_t n) const { return supplied_.holds(offset, n); }
  uint64_t gap_begin(uint64_t offset) const { return supplied_.gap_begin(offset); }
  // Drops bytes that are not wanted any more. read() fails for them with NEED_DATA.
  void drop(uint64_t offset, uint64_t n, MemoryBudget& memory) {
    if (is_supplied_) supplied_.drop(offset, n, memory);
  }
  // What `status` says of the n bytes at `offset`. If that is CHECKSUM and they were supplied, they
  // are dropped, and the first time it becomes NEED_DATA, so that they are supplied once more.
  Status after_check(Status status, uint64_t offset, uint64_t n, MemoryBudget& memory);
  // Whether that has happened twice: nobody is asked for the bytes any more.
  bool is_lost(uint64_t offset) const;

  uint64_t reads() const { return reads_; }
  uint64_t bytes_read() const { return bytes_read_; }

 private:
  Status call_reader(uint64_t offset, uint64_t n, unsigned char* to);

  ByteSpan memory_;
  l4d_reader reader_{};
  uint64_t size_ = 0;
  uint64_t reads_ = 0;
  uint64_t bytes_read_ = 0;
  FetchedBytes fetched_;
  bool trusted_ = true;
  bool is_supplied_ = false;
  SuppliedBytes supplied_;
  std::map<uint64_t, int> rejected_;  // how often, by offset
};

}  // namespace l4d
