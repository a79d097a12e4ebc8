// SPDX-License-Identifier: Apache-2.0
#include "io/file/json_text.h"

#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

namespace l4d::io {
namespace {

// What the parser quotes may be of any length and bytes.
std::string shown(std::string text) {
  if (text.size() > 160) text.replace(160, std::string::npos, "...");
  for (char& c : text) c = c >= ' ' && c < 127 ? c : '?';
  return text;
}

// Builds the document, and sees keys that are there twice. (A callback of the parser would see
// them, too, and make it look through each array once for each object in it.)
class Builder : public nlohmann::json_sax<nlohmann::json> {
 public:
  explicit Builder(nlohmann::json* root) : root_(root) {}

  bool null() override { return put(nullptr) != nullptr; }
  bool boolean(bool value) override { return put(value) != nullptr; }
  bool number_integer(int64_t value) override { return put(value) != nullptr; }
  bool number_unsigned(uint64_t value) override { return put(value) != nullptr; }
  bool number_float(double value, const std::string&) override { return put(value) != nullptr; }
  bool string(std::string& value) override { return put(std::move(value)) != nullptr; }
  bool binary(nlohmann::json::binary_t&) override { return false; }  // is not of text
  bool start_object(size_t) override { return open(nlohmann::json::object()); }
  bool start_array(size_t) override { return open(nlohmann::json::array()); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }
  bool key(std::string& name) override {
    open_.back().key = std::move(name);
    return true;
  }
  bool parse_error(size_t, const std::string&, const nlohmann::json::exception& error) override {
    wrong_ = shown(error.what());
    return false;
  }

  const std::string& wrong() const { return wrong_; }
  const std::string& twice() const { return twice_; }

 private:
  struct Open {
    nlohmann::json* value;
    std::string key;  // the last one
  };

  nlohmann::json* put(nlohmann::json&& value) {
    if (open_.empty()) return &(*root_ = std::move(value));
    Open& top = open_.back();
    if (top.value->is_array()) return &top.value->emplace_back(std::move(value));
    auto& members = top.value->get_ref<nlohmann::json::object_t&>();
    const auto [member, is_new] = members.insert_or_assign(top.key, std::move(value));
    if (!is_new) note_twice();
    return &member->second;
  }
  bool open(nlohmann::json&& value) {
    open_.push_back({put(std::move(value)), {}});
    return true;
  }
  bool close() {
    open_.pop_back();
    return true;
  }
  void note_twice() {
    if (!twice_.empty()) return;
    std::string in;
    for (size_t k = open_.size() - 1; k > 0 && in.empty(); --k) in = open_[k - 1].key;
    twice_ =
        shown(in.empty() ? "an object has a key twice" : "an object in " + in + " has a key twice");
  }

  nlohmann::json* root_;
  std::vector<Open> open_;
  std::string wrong_, twice_;
};

}  // namespace

std::string parse_json(const char* begin, const char* end, nlohmann::json* out) {
  Builder builder(out);
  nlohmann::json::sax_parse(begin, end, &builder);
  return builder.wrong().empty() ? builder.twice() : builder.wrong();
}

}  // namespace l4d::io
