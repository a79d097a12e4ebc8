// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace l4d::cli {

// What a request asks for of a file of `size` bytes (RFC 9110, section 14).
struct ByteRange {
  enum Kind { kWhole, kPart, kUnsatisfiable } kind = kWhole;
  uint64_t begin = 0, end = 0;  // of a part: [begin, end)
};

namespace byte_range_detail {
// Digits alone, and no number beyond 2^63: nothing else is one.
inline std::optional<uint64_t> number_of(const std::string& text) {
  if (text.empty() || text.size() > 18) return std::nullopt;
  uint64_t value = 0;
  for (const char c : text) {
    if (c < '0' || c > '9') return std::nullopt;
    value = 10 * value + static_cast<uint64_t>(c - '0');
  }
  return value;
}
}  // namespace byte_range_detail

// header: the value of Range, "" where there is none. Several ranges, other units and what is not
// well-formed are answered with the whole file, as servers may.
inline ByteRange parse_byte_range(const std::string& header, uint64_t size) {
  using byte_range_detail::number_of;
  const std::string unit = "bytes=";
  if (header.compare(0, unit.size(), unit) != 0) return {};
  const std::string text = header.substr(unit.size());
  const size_t dash = text.find('-');
  if (dash == std::string::npos) return {};
  const std::string first = text.substr(0, dash), last = text.substr(dash + 1);
  const std::optional<uint64_t> a = number_of(first), b = number_of(last);
  if ((!first.empty() && !a) || (!last.empty() && !b) || (!a && !b)) return {};
  if (!a) {  // the last b bytes
    if (*b == 0 || size == 0) return {ByteRange::kUnsatisfiable, 0, 0};
    return {ByteRange::kPart, size - (*b < size ? *b : size), size};
  }
  if (b && *b < *a) return {};
  if (*a >= size) return {ByteRange::kUnsatisfiable, 0, 0};
  return {ByteRange::kPart, *a, b && *b < size ? *b + 1 : size};
}

}  // namespace l4d::cli
