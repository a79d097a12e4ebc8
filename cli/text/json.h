// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <type_traits>
#include <vector>

namespace l4d::cli {

// A JSON value that is built up and printed, never parsed. Keys keep the order in which they are
// written: documents are read by people too. Parsing needs a large library, which only json.cc
// includes, so that files that make documents compile fast.
class Json {
 public:
  Json() = default;  // null
  Json(std::nullptr_t) {}
  Json(const char* text) : kind_(Kind::kText), text_(text) {}
  Json(std::string text) : kind_(Kind::kText), text_(std::move(text)) {}
  template <typename T, std::enable_if_t<std::is_arithmetic_v<T>, int> = 0>
  Json(T value) {
    if constexpr (std::is_same_v<T, bool>) {
      kind_ = Kind::kTruth;
      unsigned_ = value ? 1 : 0;
    } else if constexpr (std::is_floating_point_v<T>) {
      kind_ = Kind::kReal;
      real_ = static_cast<double>(value);
    } else if constexpr (std::is_signed_v<T>) {
      kind_ = Kind::kSigned;
      signed_ = value;
    } else {
      kind_ = Kind::kUnsigned;
      unsigned_ = value;
    }
  }
  template <typename T>
  Json(const std::vector<T>& values) : kind_(Kind::kArray) {
    for (const T& value : values) items_.emplace_back(value);
  }
  // An object where each item is a pair that begins with a text, else an array.
  Json(std::initializer_list<Json> items);
  static Json array();
  static Json object();

  // The value of a key. A null becomes an object, and a key that is not there is added as null.
  Json& operator[](const std::string& key);
  // A null becomes an array.
  void push_back(Json item);
  size_t size() const { return items_.size(); }  // of an array or object
  // Takes over all keys of another object.
  void update(const Json& other);

  // On one line, or on several that are indented by `indent` spaces for each level. Bytes of texts
  // that are no UTF-8 are replaced; numbers that are infinite or NaN become null.
  std::string dump(int indent = -1) const;

 private:
  enum class Kind { kNull, kTruth, kSigned, kUnsigned, kReal, kText, kArray, kObject };
  friend struct JsonPrinter;
  bool is_member() const;

  Kind kind_ = Kind::kNull;
  union {
    int64_t signed_ = 0;
    uint64_t unsigned_;
    double real_;
  };
  std::string text_;
  std::vector<std::string> keys_;  // of an object, one per item
  std::vector<Json> items_;
};

}  // namespace l4d::cli
