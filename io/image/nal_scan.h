// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

namespace l4d::io {

// Looks for damage in H.264 and H.265 as MP4 and Matroska store them: units that each follow their
// length of 4 bytes. No unit may contain 00 00 00, 00 00 01 or 00 00 02 but zeros at its end, and
// no length is 0. A decoder takes zeros for coded data and makes pictures of them.
class NalScan {
 public:
  // The next bytes of the coded pictures, which follow each other without gaps.
  void add(const uint8_t* bytes, size_t size);
  // Where the first unit that is wrong begins, after all bytes; nothing if all are right, or if
  // the stream does not begin with a length.
  std::optional<uint64_t> damaged_unit() const;

 private:
  void add_length(uint8_t byte);
  void add_content(uint8_t byte);

  uint64_t at_ = 0;      // bytes so far
  uint64_t unit_ = 0;    // where the unit begins, with its length
  uint64_t left_ = 0;    // bytes of the unit that are to come
  uint32_t length_ = 0;  // as far as it is read
  unsigned length_bytes_ = 0;
  uint64_t zeros_ = 0;     // that precede the next byte
  bool is_other_ = false;  // it begins with what is no length
  std::optional<uint64_t> damaged_;
};

}  // namespace l4d::io
