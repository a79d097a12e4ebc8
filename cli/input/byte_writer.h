// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "l4d/l4d.h"

namespace l4d::cli {

// Appends to `bytes`, which lives longer. Fails where there is no memory: nothing is thrown through
// a function of C.
inline l4d_writer writer_to(std::vector<uint8_t>* bytes) {
  l4d_writer writer = L4D_INIT(l4d_writer);
  writer.user = bytes;
  writer.write = [](void* user, const void* src, size_t n) {
    auto& to = *static_cast<std::vector<uint8_t>*>(user);
    const auto* from = static_cast<const uint8_t*>(src);
    try {
      to.insert(to.end(), from, from + n);
    } catch (...) {
      return 1;
    }
    return 0;
  };
  return writer;
}

}  // namespace l4d::cli
