// SPDX-License-Identifier: Apache-2.0
#include "cli/command/values.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>

#include "cli/command/failure.h"

namespace l4d::cli {
namespace {

// Reads a finite decimal number at the start of `text`; returns what follows it, or nullptr.
// from_chars, because strtod obeys the locale.
const char* read_number(const std::string& text, double* value) {
  const char* end = text.data() + text.size();
  const auto [next, error] = std::from_chars(text.data(), end, *value);
  return error == std::errc() && std::isfinite(*value) ? next : nullptr;
}

std::string drop_suffix(const std::string& text, const std::string& suffix) {
  const bool has = text.size() > suffix.size() &&
                   text.compare(text.size() - suffix.size(), suffix.size(), suffix) == 0;
  return has ? text.substr(0, text.size() - suffix.size()) : text;
}

}  // namespace

uint64_t parse_size(const std::string& text, const std::string& option) {
  double value = 0;
  const char* rest = read_number(text, &value);
  if (rest == nullptr || value < 0) {
    throw usage_error(option + ": '" + text + "' is no count or size, such as 4096, 64KiB or 1.5M");
  }
  std::string suffix = rest;
  if (!suffix.empty() && suffix.back() == 'B') suffix.pop_back();
  const double base = suffix.size() == 2 && suffix[1] == 'i' ? 1024 : 1000;
  if (base == 1024) suffix.pop_back();
  constexpr char kPrefixes[] = "kMGT";
  double factor = 1;
  if (!suffix.empty()) {
    const char prefix = suffix[0] == 'K' ? 'k' : suffix[0];
    const char* found = std::string_view(kPrefixes).find(prefix) == std::string_view::npos
                            ? nullptr
                            : kPrefixes + std::string_view(kPrefixes).find(prefix);
    if (suffix.size() != 1 || found == nullptr) {
      throw usage_error(option + ": '" + text + "': suffixes are k M G T, Ki Mi Gi Ti, then B");
    }
    factor = std::pow(base, static_cast<double>(found - kPrefixes) + 1);
  }
  const double size = value * factor;
  if (size > 9e18) throw usage_error(option + ": '" + text + "' is too large");
  if (size != std::floor(size)) {
    throw usage_error(option + ": '" + text + "' is not a whole number");
  }
  return static_cast<uint64_t>(size);
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
  const std::string amount = drop_suffix(text, "/s");
  const std::string bits = drop_suffix(amount, "bit");
  return bits != amount ? static_cast<double>(parse_size(bits, option)) / 8
                        : static_cast<double>(parse_size(amount, option));
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
