// SPDX-License-Identifier: Apache-2.0
#include "cli/text/units.h"

#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <sstream>

#include "io/file/memory.h"
#include "l4d/encode.h"

namespace l4d::cli {
namespace {

constexpr size_t kColumns = 100;

constexpr std::array<const char*, L4D_COMPONENT_COUNT> kComponentNames = {
    "sh", "scale", "rotor-spatial", "rotor-temporal"};

}  // namespace

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
