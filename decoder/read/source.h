// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "decoder/read/fetched_bytes.h"
#include "l4d/decode.h"
#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/memory.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

// Neighbouring parts of a file are read in runs of no more than about this size.
constexpr uint64_t kMaxReadBytes = uint64_t{32} << 20;

// The bytes of a stream: host memory (no copy) or a reader callback. Counts what it reads.
class ByteSource {
 public:
  ByteSource() = default;
  static ByteSource from_memory(ByteSpan data);
  static Status from_reader(const l4d_reader& reader, ByteSource* out);

  uint64_t size() const { return size_; }
  // Bytes behind the first `bytes` are not of the stream.
  void limit(uint64_t bytes) { size_ = std::min(size_, bytes); }
  // Bytes [offset, offset + n). The result aliases host memory, `storage`, or what was fetched, up
  // to the next fetch() or forget(). Fails with TRUNCATED (citing CHNK-1) where the range leaves
  // the file; nothing is allocated then.
  Status read(uint64_t offset, uint64_t n, Bytes& storage, ByteSpan* out);

  // Whether read_apart() is there: of memory, and of files of this library.
  bool reads_apart() const { return reader_.read_at == nullptr || reads_apart_; }
  // The reader may be called by several threads at once.
  void set_reads_apart() { reads_apart_ = true; }
  // Bytes [offset, offset + n) to `to`, by any number of threads at once. Nothing is counted:
  // count_reads() does that for all of them.
  Status read_apart(uint64_t offset, uint64_t n, unsigned char* to) const;
  void count_reads(uint64_t reads, uint64_t bytes) {
    reads_ += reads;
    bytes_read_ += bytes;
  }

  // How many bytes are worth one more read, 0 if reads cost nothing. Only then fetch() fetches.
#ifdef L4D_PLAYER_ONLY
  static constexpr uint64_t block_bytes() { return 0; }
#else
  uint64_t block_bytes() const { return reader_.block_bytes; }
#endif
  bool fetches() const { return block_bytes() > 0; }
  // Whether bytes of the file may be missing in the source, so that no read goes over what nobody
  // needs.
  bool has_gaps() const { return has_gaps_; }
  void set_gaps() { has_gaps_ = true; }
  // Reads ranges in few calls, so that read() needs none for any part of them. What was fetched
  // before stays as long as its reason says. What is held is not read again, what cannot be read or
  // does not fit into `memory` is left out: read() then says why.
  void fetch(std::vector<ByteRange> ranges, FetchedFor reason, MemoryBudget& memory);
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

  // What `status` says of bytes that were read. If that is CHECKSUM, they are read again later.
  Status after_check(Status status) {
    if (status.code() == L4D_ERR_CHECKSUM) distrust();
    return status;
  }

  uint64_t reads() const { return reads_; }
  uint64_t bytes_read() const { return bytes_read_; }

 private:
  Status check_range(uint64_t offset, uint64_t n) const;
  Status call_reader(uint64_t offset, uint64_t n, unsigned char* to) const;

  ByteSpan memory_;
  l4d_reader reader_{};
  uint64_t size_ = 0;
  uint64_t reads_ = 0;
  uint64_t bytes_read_ = 0;
  FetchedBytes fetched_;
  bool trusted_ = true;
  bool has_gaps_ = false;
  bool reads_apart_ = false;
};

}  // namespace l4d
