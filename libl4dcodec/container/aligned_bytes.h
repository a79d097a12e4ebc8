// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstring>
#include <vector>

#include "libl4dcodec/base/span.h"

namespace l4d {

// Bytes at an address that FlatBuffers can read its 8-byte fields from: the bytes given where they
// are aligned already, else a copy.
class AlignedBytes {
 public:
  explicit AlignedBytes(ByteSpan bytes) : size_(bytes.size()), data_(bytes.data()) {
    if (size_ == 0 || reinterpret_cast<uintptr_t>(data_) % alignof(uint64_t) == 0) return;
    copy_.resize(size_ / sizeof(uint64_t) + 1);
    std::memcpy(copy_.data(), data_, size_);
    data_ = reinterpret_cast<const unsigned char*>(copy_.data());
  }
  AlignedBytes(const AlignedBytes&) = delete;
  AlignedBytes& operator=(const AlignedBytes&) = delete;

  const unsigned char* data() const { return data_; }
  size_t size() const { return size_; }

 private:
  size_t size_;
  const unsigned char* data_;
  std::vector<uint64_t> copy_;
};

}  // namespace l4d
