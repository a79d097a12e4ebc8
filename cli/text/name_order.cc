// SPDX-License-Identifier: Apache-2.0
#include "cli/text/name_order.h"

#include <cstddef>

namespace l4d::cli {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

// The digits at `at`, without zeros before them; `at` is moved behind them.
std::string take_number(const std::string& name, size_t& at) {
  while (at < name.size() && name[at] == '0') ++at;
  const size_t first = at;
  while (at < name.size() && is_digit(name[at])) ++at;
  return name.substr(first, at - first);
}

}  // namespace

bool name_is_before(const std::string& a, const std::string& b) {
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const std::string x = take_number(a, i), y = take_number(b, j);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
    } else if (a[i] != b[j]) {
      return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
    } else {
      ++i;
      ++j;
    }
  }
  const bool a_ended = i == a.size(), b_ended = j == b.size();
  return a_ended && b_ended ? a < b : a_ended;
}

}  // namespace l4d::cli
