// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace l4d::io {

// Parses a text of JSON. Returns what is wrong with it, "" if nothing is. An object that has a key
// twice is wrong: programs differ in which of the two they take.
std::string parse_json(const char* begin, const char* end, nlohmann::json* out);

}  // namespace l4d::io
