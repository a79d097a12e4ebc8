// SPDX-License-Identifier: Apache-2.0
#include "training/cli/numbers.h"

#include <charconv>
#include <cmath>
#include <cstdlib>
#include <stdexcept>

#include "io/file/file.h"
#include "training/cli/command.h"

namespace l4d::train {
namespace {

constexpr uint64_t kMaxThreads = 1024;

bool parse_whole(const std::string& text, uint64_t* value) {
  const char* const end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, *value);
  return !text.empty() && at == end && error == std::errc();
}

std::string what_it_is(const std::string& text) { return "it is \"" + text + "\"; it must be "; }

}  // namespace

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
  return what_it_is(text) + "a number above 0";
}

std::string whole_number(const std::string& text) {
  uint64_t value = 0;
  return parse_whole(text, &value) ? "" : what_it_is(text) + "a whole number from 0 to 2^64 - 1";
}

std::string number_or_all(const std::string& text) {
  uint64_t value = 0;
  if (text == "all") return "0";
  if (parse_whole(text, &value) && value > 0 && value <= UINT32_MAX) return text;
  throw CLI::ValidationError(what_it_is(text) + "all, or a whole number from 1 on");
}

std::string number_of_threads(const std::string& text) {
  uint64_t value = 0;
  if (parse_whole(text, &value) && value <= kMaxThreads) return "";
  return what_it_is(text) + "a whole number from 0 to " + std::to_string(kMaxThreads);
}

}  // namespace l4d::train
