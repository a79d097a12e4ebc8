// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "render/cpu/fast/kernels.h"

namespace l4d::render {

using ProjectKernel = decltype(RenderKernels::project);
ProjectKernel project_kernel();

}  // namespace l4d::render
