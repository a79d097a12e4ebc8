// SPDX-License-Identifier: Apache-2.0
#include "io/file/output_name.h"

#include <algorithm>
#include <filesystem>

#include "io/file/file_kind.h"

namespace l4d::io {

std::string name_at_odds(const std::string& name, const std::vector<std::string>& written,
                         bool strict) {
  const std::filesystem::path path(name);
  std::string extension = lower_extension(name);
  const auto is_in = [&](const std::vector<std::string>& list) {
    return std::find(list.begin(), list.end(), extension) != list.end();
  };
  // Names of packed PLY have two extensions.
  const bool packed = extension == ".ply" && path.stem().extension() == ".compressed";
  const bool known = is_in({".l4d", ".ply"}) || kind_of_extension(extension);
  if (packed) extension = ".compressed.ply";
  if (extension.empty() || is_in(written) || !(strict || known || packed)) return "";
  std::string kinds;
  for (const std::string& kind : written) kinds += (kinds.empty() ? "" : " or ") + kind;
  return "'" + name + "' ends in " + extension + ", but what is written is " + kinds;
}

}  // namespace l4d::io
