// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/playlist_text.h"

#include <cmath>
#include <cstring>

namespace l4d::playback {
namespace {

constexpr double kMostSeconds = 1152921504606846976.0;    // 2^60
constexpr uint64_t kMostBytes = (uint64_t{1} << 53) - 1;  // that numbers of JavaScript can count

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_name(char c) { return (c >= 'A' && c <= 'Z') || is_digit(c) || c == '-'; }

// Powers of ten up to 10^22 are exact.
double power_of_ten(int exponent) {
  double power = 1;
  for (int k = 0; k < exponent; ++k) power *= 10;
  return power;
}

// value * 10^exponent, as near as two numbers of 53 bits can say. The library of C knows locales,
// in which 1.5 is no number.
double scaled(uint64_t value, int exponent) {
  const double high = static_cast<double>(value >> 32) * 4294967296.0;
  const double low = static_cast<double>(value & 0xffffffffu);
  const double sum = high + low, rest = low - (sum - high);
  if (exponent >= 0) return (sum + rest) * power_of_ten(exponent);
  const double power = power_of_ten(-exponent);
  const double quotient = sum / power;
  return quotient + (std::fma(-quotient, power, sum) + rest) / power;
}

// The digits of a number as one whole number, and the power of ten that it is to be multiplied by.
struct Decimal {
  uint64_t value = 0;
  int exponent = 0;
  bool has_digits = false;

  void add(char digit, bool is_fraction) {
    has_digits = true;
    const bool fits = value < uint64_t{1} << 59;
    if (fits) value = 10 * value + static_cast<uint64_t>(digit - '0');
    if (fits && is_fraction) --exponent;
    if (!fits && !is_fraction) ++exponent;
  }
};

}  // namespace

bool Text::is(const char* word) const {
  return size() == std::strlen(word) && std::memcmp(begin, word, size()) == 0;
}

bool Text::contains(char mark) const {
  return !empty() && std::memchr(begin, mark, size()) != nullptr;
}

Text Text::cut(char mark) {
  Text first{begin, begin};
  while (first.end != end && *first.end != mark) ++first.end;
  begin = first.end == end ? end : first.end + 1;
  return first;
}

bool Text::to_count(uint64_t most, uint64_t* out) const {
  if (empty() || size() > 20) return false;
  uint64_t value = 0;
  for (const char* c = begin; c != end; ++c) {
    if (!is_digit(*c)) return false;
    const uint64_t digit = static_cast<uint64_t>(*c - '0');
    if (value > (most - digit) / 10 || digit > most) return false;
    value = 10 * value + digit;
  }
  *out = value;
  return true;
}

bool Text::to_seconds(double* out) const {
  Text text = *this;
  const bool negative = !text.empty() && *text.begin == '-';
  if (!text.empty() && (*text.begin == '-' || *text.begin == '+')) ++text.begin;
  Decimal number;
  while (!text.empty() && is_digit(*text.begin)) number.add(*text.begin++, false);
  if (!text.empty() && *text.begin == '.') {
    ++text.begin;
    while (!text.empty() && is_digit(*text.begin)) number.add(*text.begin++, true);
  }
  if (!number.has_digits) return false;
  if (!text.empty()) {
    if (*text.begin != 'e' && *text.begin != 'E') return false;
    ++text.begin;
    const bool shrinks = !text.empty() && *text.begin == '-';
    if (!text.empty() && (*text.begin == '-' || *text.begin == '+')) ++text.begin;
    uint64_t exponent = 0;
    if (!text.to_count(9999, &exponent)) return false;
    number.exponent += shrinks ? -static_cast<int>(exponent) : static_cast<int>(exponent);
  }
  double value = 0;
  if (number.value != 0) {
    if (number.exponent > 18) return false;
    // Digits behind the 40th decimal are nothing.
    if (number.exponent >= -22) value = scaled(number.value, number.exponent);
    if (number.exponent < -22 && number.exponent >= -40) {
      value = scaled(number.value, -22) / power_of_ten(-22 - number.exponent);
    }
  }
  if (!(value <= kMostSeconds)) return false;
  *out = negative ? -value : value;
  return true;
}

bool Text::to_range(uint64_t* offset, uint64_t* bytes) const {
  Text rest = *this;
  if (!rest.cut('@').to_count(kMostBytes, bytes) || *bytes == 0) return false;
  return rest.to_count(kMostBytes - *bytes, offset);
}

bool Attributes::parse(Text text) {
  count_ = 0;
  do {
    Attribute one;
    one.name = text.cut('=');
    if (one.name.empty() || count_ == kMost) return false;
    for (const char* c = one.name.begin; c != one.name.end; ++c) {
      if (!is_name(*c)) return false;
    }
    for (size_t k = 0; k < count_; ++k) {
      const Text& other = list_[k].name;
      if (other.size() == one.name.size() &&
          std::memcmp(other.begin, one.name.begin, other.size()) == 0) {
        return false;
      }
    }
    bool more = false;
    if (!text.empty() && *text.begin == '"') {
      ++text.begin;
      if (!text.contains('"')) return false;
      one.value = text.cut('"');
      more = !text.empty();
      if (more && *text.begin++ != ',') return false;
    } else {
      more = text.contains(',');
      one.value = text.cut(',');
      if (one.value.empty() || one.value.contains('"') || one.value.contains(' ')) return false;
    }
    list_[count_++] = one;
    if (more && text.empty()) return false;  // a comma at the end
  } while (!text.empty());
  return true;
}

Text Attributes::get(const char* name) const {
  for (size_t k = 0; k < count_; ++k) {
    if (list_[k].name.is(name)) return list_[k].value;
  }
  return {};
}

}  // namespace l4d::playback
