// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/common.h"

namespace l4d::cli {

void add_cameras(Registry& registry);

}  // namespace l4d::cli
