// SPDX-License-Identifier: Apache-2.0
// What the language has no words for: copies that run beside other work, and addresses that stay
// whole.
#pragma once

#include <cstdint>

namespace l4d::cuda {

// Starts a copy of 16 bytes to shared memory, of which only the first `bytes` are read; the rest
// are zeros. Both addresses are multiples of 16.
__device__ inline void start_copy(unsigned char* to, const unsigned char* from,
                                  uint32_t bytes = 16) {
#if __CUDA_ARCH__ >= 800
  const uint32_t shared = static_cast<uint32_t>(__cvta_generic_to_shared(to));
  asm volatile("cp.async.cg.shared.global [%0], [%1], 16, %2;" ::"r"(shared), "l"(from), "r"(bytes)
               : "memory");
#else
  // No copy runs beside other work: it is done at once.
  if (bytes == 16) {
    *reinterpret_cast<uint4*>(to) = *reinterpret_cast<const uint4*>(from);
  } else {
    for (uint32_t i = 0; i < 16; ++i) to[i] = i < bytes ? from[i] : static_cast<unsigned char>(0);
  }
#endif
}
// Closes a group of copies.
__device__ inline void end_copies() {
#if __CUDA_ARCH__ >= 800
  asm volatile("cp.async.commit_group;" ::: "memory");
#endif
}
// Waits for all of the calling thread's groups but the last kLeft.
template <int kLeft>
__device__ void wait_for_copies() {
#if __CUDA_ARCH__ >= 800
  asm volatile("cp.async.wait_group %0;" ::"n"(kLeft) : "memory");
#endif
}

// Stores to global memory where `condition` holds. As a branch, which compilers like to make of an
// if, it would part what comes before from what comes after, and one could not fill the other's
// waits.
__device__ inline void store_if(bool condition, uint8_t* to, uint32_t value) {
  asm volatile("{ .reg .pred p; setp.ne.u32 p, %2, 0; @p st.global.u8 [%0], %1; }" ::"l"(to),
               "r"(value), "r"(static_cast<uint32_t>(condition)));
}
__device__ inline void store_if(bool condition, uint16_t* to, uint32_t value) {
  asm volatile("{ .reg .pred p; setp.ne.u32 p, %2, 0; @p st.global.u16 [%0], %1; }" ::"l"(to),
               "h"(static_cast<uint16_t>(value)), "r"(static_cast<uint32_t>(condition)));
}
__device__ inline void store_if(bool condition, uint32_t* to, uint32_t value) {
  asm volatile("{ .reg .pred p; setp.ne.u32 p, %2, 0; @p st.global.u32 [%0], %1; }" ::"l"(to),
               "r"(value), "r"(static_cast<uint32_t>(condition)));
}

// A global address as one number: compilers otherwise add its parts anew where it is used.
template <typename T>
__device__ T* whole(T* address) {
  asm("" : "+l"(address));
  __builtin_assume(__isGlobal(address));
  return address;
}

}  // namespace l4d::cuda
