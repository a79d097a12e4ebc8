// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <utility>

namespace l4d::cli {

// Parsers of option values. `option` names the option in the message of the usage error they throw.

// "4096", "4k", "1.5M", "64KiB", "2GB": SI suffixes k M G T, IEC suffixes Ki Mi Gi Ti, an optional
// B.
uint64_t parse_size(const std::string& text, const std::string& option);
double parse_number(const std::string& text, const std::string& option);
// "42", "42dB"
double parse_decibels(const std::string& text, const std::string& option);
// Seconds: "2.5", "2.5s", "1:30", "1:02:03.5".
double parse_seconds(const std::string& text, const std::string& option);
// "key=value", split at the first '='.
std::pair<std::string, std::string> parse_assignment(const std::string& text,
                                                     const std::string& option);
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
