// SPDX-License-Identifier: Apache-2.0
// Counts what operator new hands out in this program, to hold the library's memory limit against
// what it really allocates. (zstd contexts use malloc and are not seen.)
#pragma once

#include <cstdint>

namespace l4d::test {

class AllocationMeter {
 public:
  AllocationMeter();  // starts counting from here; one at a time
  // Most bytes held at once since then, above those held at the start.
  uint64_t peak() const;
  uint64_t count() const;  // of allocations since then

 private:
  int64_t at_start_;
  uint64_t count_at_start_;
};

}  // namespace l4d::test
