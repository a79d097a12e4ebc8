// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/source.h"

#include <string>

namespace l4d {

ByteSource ByteSource::from_memory(ByteSpan data) {
  ByteSource s;
  s.memory_ = data;
  s.size_ = data.size();
  return s;
}

Status ByteSource::from_reader(const l4d_reader& reader, ByteSource* out) {
  if (reader.read_at == nullptr || reader.size == nullptr) {
    return invalid_argument("the reader lacks a callback");
  }
  const int64_t size = reader.size(reader.user);
  if (size < 0) return Status(L4D_ERR_IO, "the reader cannot tell its size");
  *out = ByteSource();
  out->reader_ = reader;
  out->size_ = static_cast<uint64_t>(size);
  return {};
}

Status ByteSource::read(uint64_t offset, uint64_t n, Bytes& storage, ByteSpan* out) {
  if (offset > size_ || n > size_ - offset) {
    return Status(L4D_ERR_TRUNCATED, "CHNK-1", offset,
                  std::to_string(n) + " bytes wanted, the file has " + std::to_string(size_));
  }
  ++reads_;
  bytes_read_ += n;
  if (reader_.read_at == nullptr) {
    *out = memory_.subspan(static_cast<size_t>(offset), static_cast<size_t>(n));
    return {};
  }
  storage.resize(static_cast<size_t>(n));
  uint64_t done = 0;
  while (done < n) {
    const int64_t got = reader_.read_at(reader_.user, storage.data() + done,
                                        static_cast<size_t>(n - done), offset + done);
    if (got < 0) {
      return Status(L4D_ERR_IO, "", offset + done, "the reader failed");
    }
    if (got == 0 || static_cast<uint64_t>(got) > n - done) {
      return Status(L4D_ERR_IO, "", offset + done, "the reader ended before its own size");
    }
    done += static_cast<uint64_t>(got);
  }
  *out = ByteSpan(storage.data(), storage.size());
  return {};
}

}  // namespace l4d
