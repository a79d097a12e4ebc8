// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace l4d::io {

// Why a file of one of these extensions, as ".ply", should not have this name: it ends in that of
// another format. Else "". Names that end in no known format are left to people, unless `strict`.
std::string name_at_odds(const std::string& name, const std::vector<std::string>& written,
                         bool strict = false);

}  // namespace l4d::io
