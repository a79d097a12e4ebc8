// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

// Numbers on the command line.
namespace l4d::train {

// A number of 0 or more, of an option that may also be "auto". Throws io::Error.
double number_of(const char* option, const std::string& text);

// For CLI::Option::check: "" for a finite number above 0, else what is wrong. An option whose
// default stands for "from the capture" takes no number that means the same.
std::string above_zero(const std::string& text);

// Likewise: "" for a whole number from 0 to 2^64 - 1.
std::string whole_number(const std::string& text);
// For CLI::Option::transform: 0 for "all", which has no limit. Throws CLI::ValidationError unless
// it is that, or a whole number from 1 to 2^32 - 1.
std::string number_or_all(const std::string& text);
// For CLI::Option::check: "" for 0 to 1024.
std::string number_of_threads(const std::string& text);

}  // namespace l4d::train
