// SPDX-License-Identifier: Apache-2.0
// Parsers of option values. `option` names the option in the message of the usage error they throw.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

namespace l4d::cli {

// "4096", "4k", "1.5M", "64KiB", "2GB": SI suffixes k M G T, IEC suffixes Ki Mi Gi Ti, an optional
// B.
uint64_t parse_size(const std::string& text, const std::string& option);
double parse_number(const std::string& text, const std::string& option);
// Frames per second, above 0 and at most what timelines state: "25", "29.97", "30000/1001".
double parse_fps(const std::string& text, const std::string& option);
// "1MB/s", "8Mbit/s", "125000": bytes per second.
double parse_bitrate(const std::string& text, const std::string& option);
// "42", "42dB"
double parse_decibels(const std::string& text, const std::string& option);
// Seconds: "2.5", "2.5s", "1:30", "1:02:03.5".
double parse_seconds(const std::string& text, const std::string& option);
// "key=value", split at the first '='.
std::pair<std::string, std::string> parse_assignment(const std::string& text,
                                                     const std::string& option);

}  // namespace l4d::cli
