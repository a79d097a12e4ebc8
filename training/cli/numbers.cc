// SPDX-License-Identifier: Apache-2.0
#include "training/cli/numbers.h"

#include <cmath>
#include <cstdlib>
#include <stdexcept>

#include "io/file.h"

namespace l4d::train {

uint64_t bytes_of(const std::string& text) {
  size_t used = 0;
  double value = -1;
  try {
    value = std::stod(text, &used);
  } catch (const std::exception&) {
  }
  const std::string unit = used <= text.size() ? text.substr(used) : "";
  const double factor = unit == "k"    ? 1e3
                        : unit == "M"  ? 1e6
                        : unit == "G"  ? 1e9
                        : unit.empty() ? 1
                                       : 0;
  if (!(value >= 0 && value < 1e12) || factor == 0) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT,
                    "\"" + text + "\" is no number of bytes; 500M and 8G are");
  }
  return static_cast<uint64_t>(value * factor);
}

double number_of(const char* option, const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != 0 || !(value >= 0) || !std::isfinite(value)) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT, std::string(option) + " is \"" + text +
                                                  "\"; it must be auto, or a number of 0 or more");
  }
  return value;
}

std::string above_zero(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (!text.empty() && *end == 0 && value > 0 && std::isfinite(value)) return "";
  return "it is \"" + text + "\"; it must be a number above 0";
}

}  // namespace l4d::train
