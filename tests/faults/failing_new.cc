// SPDX-License-Identifier: Apache-2.0
#include "tests/faults/failing_new.h"

#include <atomic>
#include <cstdlib>
#include <new>

namespace {

std::atomic<bool> armed{false};
std::atomic<uint64_t> first_failure{0};
std::atomic<uint64_t> last_failure{0};
std::atomic<uint64_t> calls{0};
std::atomic<uint64_t> failures{0};
std::atomic<int64_t> live{0};

void* try_allocate(size_t n) {
  if (armed) {
    const uint64_t call = ++calls;
    if (call >= first_failure && call <= last_failure) {
      ++failures;
      return nullptr;
    }
  }
  void* p = std::malloc(n == 0 ? 1 : n);
  if (p != nullptr) ++live;
  return p;
}

void* allocate(size_t n) {
  void* p = try_allocate(n);
  if (p == nullptr) throw std::bad_alloc();
  return p;
}

void release(void* p) {
  if (p != nullptr) --live;
  std::free(p);
}

}  // namespace

// The other forms of new and delete call these, or are a pair of their own.
void* operator new(size_t n) { return allocate(n); }
void* operator new[](size_t n) { return allocate(n); }
void* operator new(size_t n, const std::nothrow_t&) noexcept { return try_allocate(n); }
void* operator new[](size_t n, const std::nothrow_t&) noexcept { return try_allocate(n); }
void operator delete(void* p) noexcept { release(p); }
void operator delete[](void* p) noexcept { release(p); }
void operator delete(void* p, const std::nothrow_t&) noexcept { release(p); }
void operator delete[](void* p, const std::nothrow_t&) noexcept { release(p); }
void operator delete(void* p, size_t) noexcept { release(p); }
void operator delete[](void* p, size_t) noexcept { release(p); }

namespace l4d::test {

AllocationFaults::AllocationFaults(uint64_t first, uint64_t last) {
  calls = 0;
  failures = 0;
  first_failure = first;
  last_failure = last;
  armed = true;
}
void AllocationFaults::stop() { armed = false; }
uint64_t AllocationFaults::count() const { return calls; }
uint64_t AllocationFaults::failed() const { return failures; }

int64_t live_allocations() { return live; }

}  // namespace l4d::test
