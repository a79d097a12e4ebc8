// SPDX-License-Identifier: Apache-2.0
#include "tests/decoder/allocation_meter.h"

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <new>

namespace {

std::atomic<int64_t> held{0};
std::atomic<int64_t> most{0};
std::atomic<uint64_t> allocations{0};

void* try_allocate(size_t n) {
  void* p = std::malloc(n == 0 ? 1 : n);
  if (p == nullptr) return nullptr;
  ++allocations;
  const int64_t now = held += static_cast<int64_t>(malloc_usable_size(p));
  int64_t seen = most.load();
  while (now > seen && !most.compare_exchange_weak(seen, now)) {
  }
  return p;
}

void* allocate(size_t n) {
  void* p = try_allocate(n);
  if (p == nullptr) throw std::bad_alloc();
  return p;
}

void release(void* p) {
  if (p != nullptr) held -= static_cast<int64_t>(malloc_usable_size(p));
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

AllocationMeter::AllocationMeter() : at_start_(held.load()), count_at_start_(allocations.load()) {
  most = at_start_;
}

uint64_t AllocationMeter::count() const { return allocations.load() - count_at_start_; }

uint64_t AllocationMeter::peak() const {
  return static_cast<uint64_t>(std::max<int64_t>(0, most.load() - at_start_));
}

}  // namespace l4d::test
