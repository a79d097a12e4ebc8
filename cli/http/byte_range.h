// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace l4d::cli {

// What a request asks for of a file of `size` bytes (RFC 9110, section 14).
struct ByteRange {
  enum Kind { kWhole, kPart, kUnsatisfiable } kind = kWhole;
  uint64_t begin = 0, end = 0;  // of a part: [begin, end)
};

namespace byte_range_detail {
// Digits alone. Numbers beyond 2^64 - 1 count as that: no file reaches so far.
inline std::optional<uint64_t> number_of(const std::string& text) {
  constexpr uint64_t most = std::numeric_limits<uint64_t>::max();
  if (text.empty()) return std::nullopt;
  uint64_t value = 0;
  for (const char c : text) {
    if (c < '0' || c > '9') return std::nullopt;
    const uint64_t digit = static_cast<uint64_t>(c - '0');
    value = value > (most - digit) / 10 ? most : 10 * value + digit;
  }
  return value;
}

// The elements of a comma-separated list without the white space around them; empty ones do not
// count.
inline std::vector<std::string> elements_of(const std::string& list) {
  std::vector<std::string> elements;
  for (size_t at = 0; at <= list.size();) {
    const size_t comma = std::min(list.find(',', at), list.size());
    const size_t begin = list.find_first_not_of(" \t", at);
    if (begin < comma) {
      const size_t end = list.find_last_not_of(" \t", comma - 1) + 1;
      elements.push_back(list.substr(begin, end - begin));
    }
    at = comma + 1;
  }
  return elements;
}

// One element; nothing where it breaks the grammar or ends before it begins.
inline std::optional<ByteRange> element_range(const std::string& text, uint64_t size) {
  const size_t dash = text.find('-');
  if (dash == std::string::npos) return std::nullopt;
  const std::string first = text.substr(0, dash), last = text.substr(dash + 1);
  const std::optional<uint64_t> a = number_of(first), b = number_of(last);
  if ((!first.empty() && !a) || (!last.empty() && !b) || (!a && !b)) return std::nullopt;
  if (!a) {  // the last b bytes
    if (*b == 0) return ByteRange{ByteRange::kUnsatisfiable, 0, 0};
    if (size == 0) return ByteRange{};
    return ByteRange{ByteRange::kPart, size - (*b < size ? *b : size), size};
  }
  if (b && *b < *a) return std::nullopt;
  if (*a >= size) return ByteRange{ByteRange::kUnsatisfiable, 0, 0};
  return ByteRange{ByteRange::kPart, *a, b && *b < size ? *b + 1 : size};
}
}  // namespace byte_range_detail

// header: the value of Range, "" where there is none. Other units and what breaks the grammar are
// ignored, as the RFC allows, and so are several ranges that the file has: the answer to these is
// the whole file.
inline ByteRange parse_byte_range(const std::string& header, uint64_t size) {
  using namespace byte_range_detail;
  const std::string unit = "bytes=";
  if (header.size() < unit.size()) return {};
  for (size_t k = 0; k < unit.size(); ++k) {
    const char c = header[k];
    if ((c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c) != unit[k]) return {};
  }
  const std::vector<std::string> elements = elements_of(header.substr(unit.size()));
  std::optional<ByteRange> found;
  bool several = false;
  for (const std::string& element : elements) {
    const std::optional<ByteRange> range = element_range(element, size);
    if (!range) return {};
    if (range->kind == ByteRange::kUnsatisfiable) continue;
    several = several || found.has_value();
    found = range;
  }
  if (elements.empty() || several) return {};
  return found.value_or(ByteRange{ByteRange::kUnsatisfiable, 0, 0});
}

}  // namespace l4d::cli
