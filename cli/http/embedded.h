// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace l4d::cli {

// A file for web pages, as it was built into the tool (cli/http/embed.cmake).
struct EmbeddedFile {
  const char* name;
  const unsigned char* data;
  unsigned size;
};
// The player; none where it was not built before the tool.
const std::vector<EmbeddedFile>& player_files();
// The page that shows pictures which this process draws (cli/http/picture).
const std::vector<EmbeddedFile>& picture_files();

}  // namespace l4d::cli
