// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace l4d::cli {

// A file of the player for web pages, as it was built into the tool (cli/http/embed.cmake).
struct PlayerFile {
  const char* name;
  const unsigned char* data;
  unsigned size;
};
// None where the player was not built before the tool.
const std::vector<PlayerFile>& player_files();

}  // namespace l4d::cli
