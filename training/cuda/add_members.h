// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "training/step/phased_backend.h"

// Sums of arrays of several members, on a device.
namespace l4d::train {

constexpr uint32_t kMaxMembers = 8, kMaxSumArrays = 12;

// Numbers of one array that members have, in memory that the device reaches.
struct MemberArray {
  uint64_t numbers;
  SumArray::Kind kind;
  bool in_words;                  // all pointers are aligned to 16 bytes
  const void* from[kMaxMembers];  // of each member, in the order of the sum
  void* to[kMaxMembers];          // where the sums go
};
struct MemberArrays {
  uint32_t members, targets, arrays;
  MemberArray array[kMaxSumArrays];
  const uint32_t* stop[kMaxMembers];  // of each member
  uint32_t* stop_any;
};

// to = from[0] + from[1] + .., from first to last; flags and `stop_any` become their union. An
// entry of `to` may be an entry of `from`.
void launch_add_members(const MemberArrays& arrays, cudaStream_t stream);

}  // namespace l4d::train
