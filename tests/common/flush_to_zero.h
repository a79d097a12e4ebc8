// SPDX-License-Identifier: Apache-2.0
// Sets flush-to-zero and denormals-are-zero for a scope, as libraries built with -ffast-math do to
// the whole process of a host application.
#pragma once

#if defined(__SSE2__) || defined(_M_X64)
#include <xmmintrin.h>
#endif

namespace l4d::test {

class FlushToZero {
 public:
#if defined(__SSE2__) || defined(_M_X64)
  static constexpr bool kAvailable = true;
  FlushToZero() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | 0x8040u); }
  ~FlushToZero() { _mm_setcsr(saved_); }
#elif defined(__aarch64__)
  static constexpr bool kAvailable = true;
  FlushToZero() {
    __asm__ volatile("mrs %0, fpcr" : "=r"(saved_));
    __asm__ volatile("msr fpcr, %0" : : "r"(saved_ | (1ul << 24)));
  }
  ~FlushToZero() { __asm__ volatile("msr fpcr, %0" : : "r"(saved_)); }
#else
  static constexpr bool kAvailable = false;
  FlushToZero() = default;
  ~FlushToZero() = default;
#endif
  FlushToZero(const FlushToZero&) = delete;
  FlushToZero& operator=(const FlushToZero&) = delete;

 private:
#if defined(__SSE2__) || defined(_M_X64)
  unsigned saved_;
#elif defined(__aarch64__)
  unsigned long saved_;
#endif
};

}  // namespace l4d::test
