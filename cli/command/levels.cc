// SPDX-License-Identifier: Apache-2.0
#include "cli/command/levels.h"

#include "l4d/experimental/inspect.h"

namespace l4d::cli {

l4d_level_limits limits_of_level(uint32_t level, uint32_t profile) {
  l4d_level_limits limits = L4D_INIT(l4d_level_limits);
  l4d_get_level_limits(level, profile, &limits);
  return limits;
}

uint32_t parse_profile(const std::string& text, const std::string& option) {
  std::string names;
  for (uint32_t p = 1; l4d_profile_name(p) != nullptr; ++p) {
    if (text == l4d_profile_name(p)) return p;
    names += (p == 1 ? "" : ", ") + std::string(l4d_profile_name(p));
  }
  throw usage_error(option + ": one of " + names);
}

uint32_t parse_level(const std::string& text, const std::string& option) {
  std::string names;
  for (uint32_t level = 1; level <= L4D_NUM_LEVELS; ++level) {
    const char* name = limits_of_level(level, L4D_PROFILE_NONE).name;
    if (text == name || text == std::to_string(level)) return level;
    names += (level == 1 ? "" : ", ") + std::to_string(level) + " " + name;
  }
  throw usage_error(option + ": one of " + names);
}

std::vector<std::string> profile_names() {
  std::vector<std::string> names;
  for (uint32_t p = 1; l4d_profile_name(p) != nullptr; ++p) names.push_back(l4d_profile_name(p));
  return names;
}

std::vector<std::string> level_names() {
  std::vector<std::string> names;
  for (uint32_t level = 1; level <= L4D_NUM_LEVELS; ++level) {
    names.push_back(limits_of_level(level, L4D_PROFILE_NONE).name);
  }
  return names;
}

std::string profile_text(uint32_t profile) {
  const char* name = l4d_profile_name(profile);
  return name != nullptr ? name : std::to_string(profile) + " (unknown)";
}

std::string level_text(uint32_t level) {
  if (level == 0) return "none";
  if (level > L4D_NUM_LEVELS) return std::to_string(level) + " (unknown)";
  return std::to_string(level) + " (" + limits_of_level(level, L4D_PROFILE_NONE).name + ")";
}

}  // namespace l4d::cli
