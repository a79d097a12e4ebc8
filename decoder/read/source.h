// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "l4d/l4d.h"
#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

// The bytes of a stream: host memory (no copy) or a reader callback. Counts what it reads.
class ByteSource {
 public:
  ByteSource() = default;
  static ByteSource from_memory(ByteSpan data);
  static Status from_reader(const l4d_reader& reader, ByteSource* out);

  uint64_t size() const { return size_; }
  // Bytes [offset, offset + n). The result aliases host memory or `storage`. Fails with TRUNCATED
  // (citing CHNK-1) where the range leaves the file; nothing is allocated then.
  Status read(uint64_t offset, uint64_t n, Bytes& storage, ByteSpan* out);

  uint64_t reads() const { return reads_; }
  uint64_t bytes_read() const { return bytes_read_; }

 private:
  ByteSpan memory_;
  l4d_reader reader_{};
  uint64_t size_ = 0;
  uint64_t reads_ = 0;
  uint64_t bytes_read_ = 0;
};

}  // namespace l4d
