// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>

#include "libl4dcodec/base/status.h"

namespace l4d {

// What one decoder holds, against its limit. Charged before the allocation it stands for.
class MemoryBudget {
 public:
  void set_limit(uint64_t bytes) { limit_ = bytes; }
  Status charge(uint64_t bytes, const char* what) {
    if (!has_room(bytes)) {
      return Status(L4D_ERR_LIMIT_EXCEEDED, std::string(what) + " needs " + std::to_string(bytes) +
                                                " bytes more than the " + std::to_string(used_) +
                                                " held; the limit is " + std::to_string(limit_));
    }
    used_ += bytes;
    peak_ = std::max(peak_, used_);
    return {};
  }
  bool has_room(uint64_t bytes) const { return bytes <= limit_ - std::min(used_, limit_); }
  // Whether `bytes` more would be allowed; charges nothing.
  Status check(uint64_t bytes, const char* what) {
    L4D_RETURN_IF_ERROR(charge(bytes, what));
    release(bytes);
    return {};
  }
  void release(uint64_t bytes) { used_ -= std::min(bytes, used_); }
  uint64_t used() const { return used_; }
  uint64_t peak() const { return peak_; }

 private:
  uint64_t limit_ = ~uint64_t{0};
  uint64_t used_ = 0;
  uint64_t peak_ = 0;
};

// A charge that is given back when this object goes, whatever ends its scope, unless it is kept.
class MemoryCharge {
 public:
  explicit MemoryCharge(MemoryBudget& budget) : budget_(budget) {}
  ~MemoryCharge() { budget_.release(bytes_); }
  MemoryCharge(const MemoryCharge&) = delete;
  MemoryCharge& operator=(const MemoryCharge&) = delete;
  Status take(uint64_t bytes, const char* what) {
    L4D_RETURN_IF_ERROR(budget_.charge(bytes, what));
    bytes_ += bytes;
    return {};
  }
  void keep() { bytes_ = 0; }

 private:
  MemoryBudget& budget_;
  uint64_t bytes_ = 0;
};

}  // namespace l4d
