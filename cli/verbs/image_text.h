// SPDX-License-Identifier: Apache-2.0
// The text of comparisons of images.
#pragma once

#include <string>

#include "cli/text/json.h"
#include "eval/image/image_comparison.h"

namespace l4d::cli {

Json image_json(const eval::ImageComparison& comparison, bool per_view);
std::string image_text(const eval::ImageComparison& comparison, bool per_view);

}  // namespace l4d::cli
