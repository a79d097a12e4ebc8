// SPDX-License-Identifier: Apache-2.0
// The words of a playlist: numbers, ranges of bytes, lists of attributes.
#pragma once

#include <cstddef>
#include <cstdint>

namespace l4d::playback {

struct Text {
  const char* begin = nullptr;
  const char* end = nullptr;

  bool empty() const { return begin == end; }
  size_t size() const { return static_cast<size_t>(end - begin); }
  bool is(const char* word) const;
  bool contains(char mark) const;
  // Takes what is before `mark`, or all of it, and the mark with it.
  Text cut(char mark);

  // Each returns whether the text is such a thing.
  bool to_count(uint64_t most, uint64_t* out) const;
  bool to_seconds(double* out) const;                      // of a magnitude up to 2^60
  bool to_range(uint64_t* offset, uint64_t* bytes) const;  // "BYTES@OFFSET"
};

// A=1,B="x,y"
class Attributes {
 public:
  bool parse(Text text);
  // Empty where there is none.
  Text get(const char* name) const;

 private:
  static constexpr size_t kMost = 16;
  struct Attribute {
    Text name, value;
  };
  Attribute list_[kMost];
  size_t count_ = 0;
};

}  // namespace l4d::playback
