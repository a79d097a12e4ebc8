// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "render/cpu/fast/kernels.h"

namespace l4d::render {

struct BlendKernels {
  decltype(RenderKernels::blend) blend;
  decltype(RenderKernels::blend_fast_exp) blend_fast_exp;
  decltype(RenderKernels::coverage) coverage;
  decltype(RenderKernels::backward) backward;
};
BlendKernels blend_kernels();

}  // namespace l4d::render
