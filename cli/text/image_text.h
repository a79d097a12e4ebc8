// SPDX-License-Identifier: Apache-2.0
// How comparisons of images are told.
#pragma once

#include <string>

#include "cli/text/json.h"
#include "eval/image_comparison.h"

namespace l4d::cli {

Json image_json(const eval::ImageComparison& comparison, bool per_view);
std::string image_text(const eval::ImageComparison& comparison, bool per_view);

}  // namespace l4d::cli
