// SPDX-License-Identifier: Apache-2.0
#include "io/file/amounts.h"

#include <charconv>
#include <cmath>
#include <string_view>

#include "io/file/file.h"

namespace l4d::io {
namespace {

[[noreturn]] void refuse(const std::string& what) { throw Error(L4D_ERR_INVALID_ARGUMENT, what); }

}  // namespace

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

uint64_t parse_size(const std::string& text, const std::string& option) {
  double value = 0;
  const char* rest = read_number(text, &value);
  if (rest == nullptr || value < 0) {
    refuse(option + ": '" + text + "' is no count or size, such as 4096, 64KiB or 1.5M");
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
      refuse(option + ": '" + text + "': suffixes are k M G T, Ki Mi Gi Ti, then B");
    }
    factor = std::pow(base, static_cast<double>(found - kPrefixes) + 1);
  }
  const double size = value * factor;
  if (size > 9e18) refuse(option + ": '" + text + "' is too large");
  if (size != std::floor(size)) {
    refuse(option + ": '" + text + "' is not a whole number");
  }
  return static_cast<uint64_t>(size);
}

double parse_bitrate(const std::string& text, const std::string& option) {
  const std::string amount = drop_suffix(text, "/s");
  const std::string bits = drop_suffix(amount, "bit");
  return bits != amount ? static_cast<double>(parse_size(bits, option)) / 8
                        : static_cast<double>(parse_size(amount, option));
}

}  // namespace l4d::io
