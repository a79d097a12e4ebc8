// SPDX-License-Identifier: Apache-2.0
// Numbers as text, for people.
#pragma once

#include <cstdint>
#include <string>

namespace l4d::cli {

// sh, scale, rotor-spatial, rotor-temporal.
const char* component_name(uint32_t component);

// "1 member", "3 members".
std::string format_items(uint64_t count, const std::string& what);
// "55.6 MB", "213,874", "1.25e-03", "3.2 s": for people.
std::string format_bytes(uint64_t bytes);
std::string format_count(uint64_t count);
std::string format_error(double value);
std::string format_seconds(double seconds);
// As few digits as tell the value apart for a person: "29.97", "5", "0.008333".
std::string format_number(double value);
// A time of the scene's clock: to the millisecond, as seconds since 1970 are; from 10^12 s on in
// six digits.
std::string format_time(double seconds);
// `text` in lines of at most 100 columns that begin at column `indent`; the first is not indented.
std::string wrap(const std::string& text, size_t indent);
// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

}  // namespace l4d::cli
