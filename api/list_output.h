// SPDX-License-Identifier: Apache-2.0
// Lists that calls copy into arrays of the caller.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace l4d::api {

// An array of `capacity` elements that may be NULL if that is 0, and where their number goes.
inline const char* bad_output(const void* out, uint64_t capacity, const uint64_t* count) {
  const bool lacks = count == nullptr || (capacity > 0 && out == nullptr);
  return lacks ? "a required pointer is NULL" : nullptr;
}

template <typename T>
void copy_out(const std::vector<T>& from, T* out, uint64_t capacity, uint64_t* count) {
  std::copy_n(from.begin(), std::min<uint64_t>(capacity, from.size()), out);
  *count = from.size();
}

}  // namespace l4d::api
