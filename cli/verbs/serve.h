// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/common.h"

namespace l4d::cli {

// In a build without the HTTP library both say so.
void add_serve(Registry& registry);
void add_view(Registry& registry);

}  // namespace l4d::cli
