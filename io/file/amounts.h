// SPDX-License-Identifier: Apache-2.0
// Amounts as people write them. `option` names what has them in the message of the io::Error that
// they throw.
#pragma once

#include <cstdint>
#include <string>

namespace l4d::io {

// "4096", "4k", "1.5M", "64KiB", "2GB": SI suffixes k M G T, IEC suffixes Ki Mi Gi Ti, an optional
// B.
uint64_t parse_size(const std::string& text, const std::string& option);
// "1MB/s", "8Mbit/s", "125000": bytes per second.
double parse_bitrate(const std::string& text, const std::string& option);
// A finite decimal number at the start of `text`, whatever the locale; returns what follows it, or
// nullptr.
const char* read_number(const std::string& text, double* value);
// `text` without `suffix` at its end, unless it has no more than that.
std::string drop_suffix(const std::string& text, const std::string& suffix);

}  // namespace l4d::io
