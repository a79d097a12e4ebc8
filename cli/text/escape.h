// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace l4d::cli {

// For a path of a URL: bytes that may not stand there become %XX.
std::string percent_encoded(const std::string& text);
// %XX become bytes, what else has a "%" stays.
std::string percent_decoded(const std::string& text);

// For a text or an attribute of HTML or XML.
std::string marked_up(const std::string& text);

}  // namespace l4d::cli
