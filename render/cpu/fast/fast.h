// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "libl4dcodec/base/memory.h"
#include "render/cpu/rasterizer.h"

namespace l4d::render {

// Charges what it holds to `memory`, which outlives it.
std::unique_ptr<Rasterizer<float>> make_fast_rasterizer(int threads, bool fast_exponential,
                                                        MemoryBudget& memory);

}  // namespace l4d::render
