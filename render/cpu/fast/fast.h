// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>

#include "libl4dcodec/base/memory.h"
#include "render/cpu/rasterizer.h"

namespace l4d::render {

// Charges what it holds to `memory`, which outlives it, as does `cancel`: another thread makes
// calls fail with CANCELLED by setting that to another number than 0.
std::unique_ptr<Rasterizer<float>> make_fast_rasterizer(int threads, bool fast_exponential,
                                                        MemoryBudget& memory,
                                                        const int32_t* cancel = nullptr);

}  // namespace l4d::render
