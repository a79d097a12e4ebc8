// SPDX-License-Identifier: Apache-2.0
#include "cli/text/units.h"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <sstream>

#include "cli/common.h"

namespace l4d::cli {
namespace {

constexpr size_t kColumns = 100;

constexpr std::array<const char*, L4D_COMPONENT_COUNT> kComponentNames = {
    "sh", "scale", "rotor-spatial", "rotor-temporal"};

// Reads a finite decimal number at the start of `text`; returns what follows it, or nullptr.
// from_chars, because strtod obeys the locale.
const char* read_number(const std::string& text, double* value) {
  const char* end = text.data() + text.size();
  const auto [next, error] = std::from_chars(text.data(), end, *value);
  return error == std::errc() && std::isfinite(*value) ? next : nullptr;
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

double parse_decibels(const std::string& text, const std::string& option) {
  const bool has_unit = text.size() > 2 && text.compare(text.size() - 2, 2, "dB") == 0;
  return parse_number(has_unit ? text.substr(0, text.size() - 2) : text, option);
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

const char* component_name(uint32_t component) { return kComponentNames[component]; }

std::string format_bytes(uint64_t bytes) { return io::text_of_bytes(bytes); }

std::string format_count(uint64_t count) {
  std::string digits = std::to_string(count);
  for (size_t at = digits.size(); at > 3;) digits.insert(at -= 3, ",");
  return digits;
}

std::string format_items(uint64_t count, const std::string& what) {
  return format_count(count) + " " + what + (count == 1 ? "" : "s");
}

std::string format_error(double value) {
  if (!std::isfinite(value)) return "-";
  return value == 0 ? "0" : format("%.3g", value);
}

std::string format_seconds(double seconds) {
  if (seconds < 60) return format(seconds < 9.95 ? "%.2f s" : "%.1f s", seconds);
  const auto whole = static_cast<uint64_t>(seconds + 0.5);
  if (whole < 3600) {
    return format("%u:%02u min", static_cast<unsigned>(whole / 60),
                  static_cast<unsigned>(whole % 60));
  }
  return format("%u:%02u:%02u h", static_cast<unsigned>(whole / 3600),
                static_cast<unsigned>(whole / 60 % 60), static_cast<unsigned>(whole % 60));
}

std::string format_number(double value) {
  return format("%.6g", value == 0 ? 0.0 : value);  // no "-0"
}

std::string format_time(double seconds) {
  const double size = std::fabs(seconds);
  return size < 1000 || size >= 1e12 ? format_number(seconds) : format("%.3f", seconds);
}

std::string wrap(const std::string& text, size_t indent) {
  std::istringstream words(text);
  std::string lines;
  size_t column = indent;
  for (std::string word; words >> word;) {
    if (column > indent && column + 1 + word.size() > kColumns) {
      lines += '\n' + std::string(indent, ' ');
      column = indent;
    }
    if (column > indent) {
      lines += ' ';
      ++column;
    }
    lines += word;
    column += word.size();
  }
  return lines;
}

std::string format(const char* pattern, ...) {
  std::va_list arguments;
  va_start(arguments, pattern);
  std::va_list again;
  va_copy(again, arguments);
  const int length = std::vsnprintf(nullptr, 0, pattern, arguments);
  va_end(arguments);
  std::string text(static_cast<size_t>(length), '\0');
  std::vsnprintf(text.data(), text.size() + 1, pattern, again);
  va_end(again);
  return text;
}

}  // namespace l4d::cli
