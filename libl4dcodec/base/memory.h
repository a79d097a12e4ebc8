// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "libl4dcodec/base/status.h"

namespace l4d {

// What one handle holds, against its limit. Charged before the allocation it stands for.
class MemoryBudget {
 public:
  MemoryBudget() = default;
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;
  ~MemoryBudget() {
    if (shared_ != nullptr) shared_->release(used_);
  }
  void set_limit(uint64_t bytes) { limit_ = bytes; }
  // What several handles hold together is limited, too. Before the first charge; outlives this one.
  void share(MemoryBudget* of_all) { shared_ = of_all; }
  Status charge(uint64_t bytes, const char* what) {
    if (!has_capacity(bytes)) {
      return Status(L4D_ERR_LIMIT_EXCEEDED, std::string(what) + " needs " + std::to_string(bytes) +
                                                " bytes more than the " + std::to_string(used_) +
                                                " held; the limit is " + std::to_string(limit_));
    }
    if (shared_ != nullptr) L4D_RETURN_IF_ERROR(shared_->charge(bytes, what));
    used_ += bytes;
    peak_ = std::max(peak_, used_);
    return {};
  }
  bool has_capacity(uint64_t bytes) const { return bytes <= capacity(); }
  // Whether `bytes` more would be allowed; charges nothing.
  Status check(uint64_t bytes, const char* what) {
    L4D_RETURN_IF_ERROR(charge(bytes, what));
    release(bytes);
    return {};
  }
  void release(uint64_t bytes) {
    bytes = std::min(bytes, used_);
    used_ -= bytes;
    if (shared_ != nullptr) shared_->release(bytes);
  }
  uint64_t capacity() const {
    const uint64_t own = limit_ - std::min(used_, limit_);
    return shared_ == nullptr ? own : std::min(own, shared_->capacity());
  }
  uint64_t used() const { return used_; }
  uint64_t peak() const { return peak_; }

 private:
  uint64_t limit_ = ~uint64_t{0};
  uint64_t used_ = 0;
  uint64_t peak_ = 0;
  MemoryBudget* shared_ = nullptr;
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
  // Gives back what is above `bytes`.
  void shrink_to(uint64_t bytes) {
    if (bytes >= bytes_) return;
    budget_.release(bytes_ - bytes);
    bytes_ = bytes;
  }

 private:
  MemoryBudget& budget_;
  uint64_t bytes_ = 0;
};

// Vectors that are charged by their capacity, from their first element to forget().

template <typename T>
void forget(MemoryBudget& budget, std::vector<T>* v) {
  budget.release(uint64_t{v->capacity()} * sizeof(T));
  std::vector<T>().swap(*v);
}

// Gives `v` n elements and keeps those that it has. While a larger array is filled from the old
// one, both are charged. If the budget allows, the array is somewhat larger than `n`, so that a
// number that rises slowly does not move it each time.
template <typename T>
Status grow(MemoryBudget& budget, std::vector<T>* v, size_t n, const char* what) {
  if (n > v->capacity()) {
    const size_t roomy = n + n / 8;
    const size_t taken = budget.has_capacity(uint64_t{roomy} * sizeof(T)) ? roomy : n;
    MemoryCharge charge(budget);
    L4D_RETURN_IF_ERROR(charge.take(uint64_t{taken} * sizeof(T), what));
    const uint64_t before = uint64_t{v->capacity()} * sizeof(T);
    v->reserve(taken);
    charge.keep();
    budget.release(before);
  }
  v->resize(n);
  return {};
}

// Gives `v` n elements, without regard to what it holds. An array that has become far too large is
// given back.
template <typename T>
Status renew(MemoryBudget& budget, std::vector<T>* v, size_t n, const char* what) {
  if (n > v->capacity() || n < v->capacity() / 4) forget(budget, v);
  return grow(budget, v, n, what);
}

}  // namespace l4d
