// SPDX-License-Identifier: Apache-2.0
#include "io/file/json_text.h"

#include <nlohmann/json.hpp>
#include <vector>

namespace l4d::io {
namespace {

// What the parser quotes may be of any length and bytes.
std::string shown(std::string text) {
  if (text.size() > 160) text.replace(160, std::string::npos, "...");
  for (char& c : text) c = c >= ' ' && c < 127 ? c : '?';
  return text;
}

// Counts the keys of objects while they are read: an object ends up with fewer if one is there
// twice.
class KeyCounts {
 public:
  bool see(nlohmann::json::parse_event_t event, const nlohmann::json& value) {
    using Event = nlohmann::json::parse_event_t;
    if (event == Event::object_start) open_.emplace_back();
    if (event == Event::key) {
      ++open_.back().keys;
      open_.back().last = value.get<std::string>();
    }
    if (event == Event::object_end) {
      const size_t keys = open_.back().keys;
      open_.pop_back();
      if (keys != value.size() && twice_.empty()) {
        twice_ = shown(open_.empty() ? "an object has a key twice"
                                     : "an object in " + open_.back().last + " has a key twice");
      }
    }
    return true;
  }
  const std::string& twice() const { return twice_; }

 private:
  struct Object {
    size_t keys = 0;
    std::string last;
  };
  std::vector<Object> open_;
  std::string twice_;
};

}  // namespace

std::string parse_json(const char* begin, const char* end, nlohmann::json* out) {
  KeyCounts counts;
  try {
    *out = nlohmann::json::parse(
        begin, end, [&](int /*depth*/, nlohmann::json::parse_event_t event, nlohmann::json& value) {
          return counts.see(event, value);
        });
  } catch (const nlohmann::json::exception& error) {
    return shown(error.what());
  }
  return counts.twice();
}

}  // namespace l4d::io
