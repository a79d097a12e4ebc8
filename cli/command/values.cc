// SPDX-License-Identifier: Apache-2.0
#include "cli/command/values.h"

#include <algorithm>
#include <cmath>

#include "cli/command/failure.h"
#include "io/file/amounts.h"
#include "io/file/file.h"

namespace l4d::cli {
namespace {

using io::drop_suffix;
using io::read_number;

// What is wrong with an option's value is a usage error.
template <typename Parse>
auto as_usage(const Parse& parse) {
  try {
    return parse();
  } catch (const io::Error& error) {
    throw usage_error(error.what());
  }
}

}  // namespace

uint64_t parse_size(const std::string& text, const std::string& option) {
  return as_usage([&] { return io::parse_size(text, option); });
}

double parse_number(const std::string& text, const std::string& option) {
  double value = 0;
  const char* rest = read_number(text, &value);
  if (rest == nullptr || *rest != '\0') {
    throw usage_error(option + ": '" + text + "' is not a number");
  }
  return value;
}

double parse_fps(const std::string& text, const std::string& option) {
  const size_t slash = std::min(text.find('/'), text.size());
  double fps = parse_number(text.substr(0, slash), option);
  if (slash < text.size()) fps /= parse_number(text.substr(slash + 1), option);
  if (!(fps > 0 && fps <= 1e6)) {
    throw usage_error(option + " is " + text + "; it must be above 0 and at most 1000000");
  }
  return fps;
}

double parse_bitrate(const std::string& text, const std::string& option) {
  return as_usage([&] { return io::parse_bitrate(text, option); });
}

double parse_decibels(const std::string& text, const std::string& option) {
  return parse_number(drop_suffix(text, "dB"), option);
}

double parse_seconds(const std::string& text, const std::string& option) {
  const bool negative = !text.empty() && text[0] == '-';
  std::string rest = negative ? text.substr(1) : text;
  if (!rest.empty() && rest.back() == 's') rest.pop_back();
  double seconds = 0;
  size_t fields = 0;
  for (size_t begin = 0; begin <= rest.size(); ++fields) {
    const size_t colon = std::min(rest.find(':', begin), rest.size());
    const std::string field = rest.substr(begin, colon - begin);
    double value = 0;
    const char* end = read_number(field, &value);
    const bool last = colon == rest.size();
    // "1:75" and "1.5:00" are slips, not times.
    if (end == nullptr || *end != '\0' || value < 0 || fields > 2 ||
        (!last && value != std::floor(value)) || (fields > 0 && value >= 60)) {
      throw usage_error(option + ": '" + text + "' is not a time, such as 2.5, 1:30 or 1:02:03.5");
    }
    seconds = seconds * 60 + value;
    begin = colon + 1;
  }
  return negative ? -seconds : seconds;
}

std::pair<std::string, std::string> parse_assignment(const std::string& text,
                                                     const std::string& option) {
  const size_t at = text.find('=');
  if (at == std::string::npos || at == 0) {
    throw usage_error(option + ": '" + text + "' should read NAME=VALUE");
  }
  return {text.substr(0, at), text.substr(at + 1)};
}

}  // namespace l4d::cli
