// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "libl4dcodec/base/memory.h"

namespace l4d::render {

// For tests that are not about memory.
inline MemoryBudget& unlimited() {
  static MemoryBudget budget;
  return budget;
}

}  // namespace l4d::render
