// SPDX-License-Identifier: Apache-2.0
// operator new of this program, which fails on request. (zstd contexts use malloc and are
// not seen.)
#pragma once

#include <cstdint>

namespace l4d::test {

// While one lives, allocations of all threads are counted, from 1, and those with a number from
// `first` to `last` fail. One at a time.
class AllocationFaults {
 public:
  static constexpr uint64_t kNever = ~uint64_t{0};
  explicit AllocationFaults(uint64_t first = kNever, uint64_t last = kNever);
  ~AllocationFaults() { stop(); }
  AllocationFaults(const AllocationFaults&) = delete;
  AllocationFaults& operator=(const AllocationFaults&) = delete;
  void stop();
  uint64_t count() const;   // allocations since the beginning
  uint64_t failed() const;  // how many of them failed
};

// Blocks that were handed out by operator new and not given back.
int64_t live_allocations();

}  // namespace l4d::test
