// SPDX-License-Identifier: Apache-2.0
// Profiles and conformance levels as people name them.
#pragma once

#include <string>
#include <vector>

#include "cli/command/context.h"
#include "l4d/experimental/inspect.h"

namespace l4d::cli {

// "main", by name; a usage error of `option` lists the names.
uint32_t parse_profile(const std::string& text, const std::string& option);
// By number or name: "1", "phone".
uint32_t parse_level(const std::string& text, const std::string& option);

// All of them, in order.
std::vector<std::string> profile_names();
std::vector<std::string> level_names();

// "main"; "none" for 0.
std::string profile_text(uint32_t profile);
// "1 (phone)"; "none" for 0.
std::string level_text(uint32_t level);

l4d_level_limits limits_of_level(uint32_t level, uint32_t profile);

}  // namespace l4d::cli
