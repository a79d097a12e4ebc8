// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace l4d::cli {

// The order in which people count names: runs of digits by their value, so that "piece_9" is before
// "piece_10". Names that differ in zeros before numbers alone are ordered by their bytes.
bool name_is_before(const std::string& a, const std::string& b);

}  // namespace l4d::cli
