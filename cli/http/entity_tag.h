// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace l4d::cli {

// Whether a value of If-None-Match (weak) or If-Match (strong) names `tag`, which is in quotes and
// not weak (RFC 9110, sections 8.8.3 and 13.1). "*" names every tag. What breaks the grammar ends
// the list.
inline bool names_tag(const std::string& list, const std::string& tag, bool weak) {
  size_t at = 0;
  while ((at = list.find_first_not_of(" \t,", at)) != std::string::npos) {
    if (list[at] == '*') return true;
    const bool is_weak = list.compare(at, 2, "W/") == 0;
    if (is_weak) at += 2;
    if (at >= list.size() || list[at] != '"') return false;
    const size_t end = list.find('"', at + 1);
    if (end == std::string::npos) return false;
    if ((weak || !is_weak) && list.compare(at, end + 1 - at, tag) == 0) return true;
    at = end + 1;
  }
  return false;
}

}  // namespace l4d::cli
