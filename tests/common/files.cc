// SPDX-License-Identifier: Apache-2.0
#include "tests/common/files.h"

#include <cstdlib>
#include <filesystem>

namespace l4d::test {

// L4D_SOURCE_DIR is of this file alone: another file that names it is compiled anew in each clone.
std::string source_file(const std::string& path) {
  return std::string(L4D_SOURCE_DIR) + "/" + path;
}

std::string data_file(const std::string& name) {
  const char* given = std::getenv("L4D_DATA_DIR");
  const std::filesystem::path folder = given != nullptr ? given : source_file("../shared/data");
  std::error_code error;
  return std::filesystem::exists(folder / name, error) ? (folder / name).string() : "";
}

}  // namespace l4d::test
