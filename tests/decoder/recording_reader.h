// SPDX-License-Identifier: Apache-2.0
// A reader over bytes in memory that keeps what it is asked for.
#pragma once

#include <algorithm>
#include <cstring>
#include <vector>

#include "l4d/l4d.hpp"
#include "libl4dcodec/base/bytes.h"

namespace l4d::test {

struct RecordingReader {
  explicit RecordingReader(const Bytes& of) : bytes(of) {}

  struct Read {
    uint64_t offset, n;
  };
  const Bytes& bytes;
  std::vector<Read> reads;

  // How many reads took the byte at `offset`.
  size_t reads_of(uint64_t offset) const {
    return static_cast<size_t>(std::count_if(reads.begin(), reads.end(), [&](const Read& r) {
      return r.offset <= offset && offset - r.offset < r.n;
    }));
  }

  l4d_reader reader() {
    l4d_reader r{};
    r.struct_size = sizeof r;
    r.user = this;
    r.size = [](void* user) {
      return static_cast<int64_t>(static_cast<RecordingReader*>(user)->bytes.size());
    };
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
      auto& self = *static_cast<RecordingReader*>(user);
      self.reads.push_back({offset, n});
      std::memcpy(dst, self.bytes.data() + offset, n);
      return static_cast<int64_t>(n);
    };
    return r;
  }
};

}  // namespace l4d::test
