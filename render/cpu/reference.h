// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "libl4dcodec/base/memory.h"
#include "render/cpu/rasterizer.h"

namespace l4d::render {

// What other rasterisers are measured against: double precision, one thread, splat by splat, no
// shortcuts but the box in which a splat can be seen.
// Charges what it holds to `memory`, which outlives it.
std::unique_ptr<Rasterizer<double>> make_reference_rasterizer(MemoryBudget& memory);

// The image before it is rounded to float. rgb [height, width, 3] and alpha [height, width] may be
// NULL, stats too.
void render_reference(const Frame<double>& frame, const View<double>& view,
                      const float* background /* [3] */, double* rgb, double* alpha, Stats* stats);

}  // namespace l4d::render
