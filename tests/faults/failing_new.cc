// SPDX-License-Identifier: Apache-2.0
#include "tests/faults/failing_new.h"

#include <array>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <new>

#if defined(__SANITIZE_ADDRESS__)
#define L4D_KEEPS_LARGE_BLOCKS
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define L4D_KEEPS_LARGE_BLOCKS
#endif
#endif
#ifdef L4D_KEEPS_LARGE_BLOCKS
#include <sanitizer/asan_interface.h>
// Of sanitizer/allocator_interface.h, which gcc does not have.
extern "C" {
size_t __sanitizer_get_allocated_size(const volatile void* p);
int __sanitizer_get_ownership(const volatile void* p);
}
#endif

namespace {

std::atomic<bool> armed{false};
std::atomic<uint64_t> first_failure{0};
std::atomic<uint64_t> last_failure{0};
std::atomic<uint64_t> calls{0};
std::atomic<uint64_t> failures{0};
std::atomic<int64_t> live{0};

#ifdef L4D_KEEPS_LARGE_BLOCKS
// The sanitizer takes each large block from the system and gives it back, page by page: most of the
// time of a program whose engines have a pool each, and are made by the thousand. So the last ones
// are kept here, where nobody may touch them, until one of the same size is wanted.
class LargeBlocks {
 public:
  static constexpr size_t kLeast = size_t{1} << 18;

  // nullptr: none of that size is kept.
  void* take(size_t n) {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (size_t i = 0; i < kept_.size(); ++i) {
      // From the one that has been here longest.
      void*& place = kept_[(next_ + i) % kept_.size()];
      if (place == nullptr || __sanitizer_get_allocated_size(place) != n) continue;
      void* const p = place;
      place = nullptr;
      ASAN_UNPOISON_MEMORY_REGION(p, n);
      std::memset(p, 0xbe, 4096);  // as the sanitizer fills what is new
      return p;
    }
    return nullptr;
  }
  // What has to be freed in place of p, or nullptr.
  void* keep(void* p) {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (void* other : kept_) {
      if (other == p) std::abort();  // it is given back twice
    }
    void* const old = kept_[next_];
    kept_[next_] = p;
    next_ = (next_ + 1) % kept_.size();
    ASAN_POISON_MEMORY_REGION(p, __sanitizer_get_allocated_size(p));
    if (old != nullptr) ASAN_UNPOISON_MEMORY_REGION(old, __sanitizer_get_allocated_size(old));
    return old;
  }

 private:
  std::mutex mutex_;
  std::array<void*, 16> kept_{};
  size_t next_ = 0;
};
LargeBlocks large_blocks;

void* get(size_t n) {
  void* const kept = n >= LargeBlocks::kLeast ? large_blocks.take(n) : nullptr;
  return kept != nullptr ? kept : std::malloc(n);
}
void give_back(void* p) {
  // What is no block is for the sanitizer to tell.
  if (__sanitizer_get_ownership(p) != 0 &&
      __sanitizer_get_allocated_size(p) >= LargeBlocks::kLeast) {
    p = large_blocks.keep(p);
  }
  std::free(p);
}
#else
void* get(size_t n) { return std::malloc(n); }
void give_back(void* p) { std::free(p); }
#endif

void* try_allocate(size_t n) {
  if (armed) {
    const uint64_t call = ++calls;
    if (call >= first_failure && call <= last_failure) {
      ++failures;
      return nullptr;
    }
  }
  void* p = get(n == 0 ? 1 : n);
  if (p != nullptr) ++live;
  return p;
}

void* allocate(size_t n) {
  void* p = try_allocate(n);
  if (p == nullptr) throw std::bad_alloc();
  return p;
}

void release(void* p) {
  if (p == nullptr) return;
  --live;
  give_back(p);
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
