// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "render/rasterizer.h"

namespace l4d::render {

std::unique_ptr<Rasterizer<float>> make_fast_rasterizer(int threads, bool fast_exponential);

}  // namespace l4d::render
