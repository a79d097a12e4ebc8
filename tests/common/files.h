// SPDX-License-Identifier: Apache-2.0
// Files that tests read, wherever the tree lies and whatever the working directory is.
#pragma once

#include <string>

namespace l4d::test {

// The file `path` of the source tree.
std::string source_file(const std::string& path);

// The file or folder `name` of the real data: of $L4D_DATA_DIR, else of shared/data next to the
// source tree. "" if it does not exist.
std::string data_file(const std::string& name);

}  // namespace l4d::test
