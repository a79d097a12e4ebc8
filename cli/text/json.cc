// SPDX-License-Identifier: Apache-2.0
#include "cli/text/json.h"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace l4d::cli {

struct JsonPrinter {
  using Document = nlohmann::ordered_json;

  static Document document_of(const Json& json) {
    switch (json.kind_) {
      case Json::Kind::kTruth:
        return json.unsigned_ != 0;
      case Json::Kind::kSigned:
        return json.signed_;
      case Json::Kind::kUnsigned:
        return json.unsigned_;
      case Json::Kind::kReal:
        return json.real_;
      case Json::Kind::kText:
        return json.text_;
      case Json::Kind::kArray: {
        Document array = Document::array();
        for (const Json& item : json.items_) array.push_back(document_of(item));
        return array;
      }
      case Json::Kind::kObject: {
        Document object = Document::object();
        for (size_t i = 0; i < json.items_.size(); ++i) {
          object[json.keys_[i]] = document_of(json.items_[i]);
        }
        return object;
      }
      default:
        return nullptr;
    }
  }
};

bool Json::is_member() const {
  return kind_ == Kind::kArray && items_.size() == 2 && items_[0].kind_ == Kind::kText;
}

Json::Json(std::initializer_list<Json> items) : kind_(Kind::kArray) {
  if (!std::all_of(items.begin(), items.end(), [](const Json& j) { return j.is_member(); })) {
    items_.assign(items.begin(), items.end());
    return;
  }
  kind_ = Kind::kObject;
  for (const Json& item : items) (*this)[item.items_[0].text_] = item.items_[1];
}

Json Json::array() {
  Json json;
  json.kind_ = Kind::kArray;
  return json;
}

Json Json::object() {
  Json json;
  json.kind_ = Kind::kObject;
  return json;
}

Json& Json::operator[](const std::string& key) {
  if (kind_ == Kind::kNull) kind_ = Kind::kObject;
  const auto found = std::find(keys_.begin(), keys_.end(), key);
  if (found != keys_.end()) return items_[static_cast<size_t>(found - keys_.begin())];
  keys_.push_back(key);
  return items_.emplace_back();
}

void Json::push_back(Json item) {
  if (kind_ == Kind::kNull) kind_ = Kind::kArray;
  items_.push_back(std::move(item));
}

void Json::update(const Json& other) {
  for (size_t i = 0; i < other.items_.size(); ++i) (*this)[other.keys_[i]] = other.items_[i];
}

std::string Json::dump(int indent) const {
  return JsonPrinter::document_of(*this).dump(indent, ' ', false,
                                              JsonPrinter::Document::error_handler_t::replace);
}

}  // namespace l4d::cli
