// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "io/camera/cameras.h"

namespace l4d::io {

// Names in notes what a file of cameras says and no reader takes. A key that is misspelt would
// otherwise leave its camera without what it says. Each key is named once, with the first camera
// that has it. One of null says nothing.
class UnknownKeys {
 public:
  explicit UnknownKeys(CameraSet* set) : set_(set) {}

  template <size_t N>
  void look(const nlohmann::json& object, const char* const (&known)[N], const std::string& owner) {
    for (const auto& item : object.items()) {
      const std::string& key = item.key();
      if (std::find(std::begin(known), std::end(known), key) != std::end(known)) continue;
      if (item.value().is_null()) continue;
      if (named_.size() == kMaxNamed || !named_.insert(key).second) continue;
      set_->notes.push_back("The key \"" + printable(key) + "\" of " + owner +
                            " is not known, and is ignored.");
    }
  }

 private:
  static constexpr size_t kMaxNamed = 20;

  static std::string printable(const std::string& key) {
    std::string out = key.substr(0, 40);
    for (char& c : out) c = c >= ' ' && c < 127 ? c : '?';
    return out;
  }

  CameraSet* set_;
  std::set<std::string> named_;
};

}  // namespace l4d::io
