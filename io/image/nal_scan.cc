// SPDX-License-Identifier: Apache-2.0
#include "io/image/nal_scan.h"

namespace l4d::io {
namespace {

constexpr unsigned kLengthBytes = 4;

}  // namespace

void NalScan::add_length(uint8_t byte) {
  if (length_bytes_ == 0) unit_ = at_;
  length_ = length_ << 8 | byte;
  if (++length_bytes_ < kLengthBytes) return;
  // A start code in place of the first length: units without lengths.
  if (unit_ == 0 && (length_ == 1 || length_ >> 8 == 1)) is_other_ = true;
  if (length_ == 0) damaged_ = unit_;
  left_ = length_;
  length_ = 0;
  length_bytes_ = 0;
  zeros_ = 0;
}

void NalScan::add_content(uint8_t byte) {
  --left_;
  if (byte == 0) {
    ++zeros_;
    return;
  }
  // 00 00 00 x, unless all that follows is zero, and 00 00 01, 00 00 02.
  if (zeros_ > 2 || (zeros_ == 2 && byte < 3)) damaged_ = unit_;
  zeros_ = 0;
}

void NalScan::add(const uint8_t* bytes, size_t size) {
  for (size_t k = 0; k < size && !damaged_ && !is_other_; ++k, ++at_) {
    if (left_ == 0) {
      add_length(bytes[k]);
    } else {
      add_content(bytes[k]);
    }
  }
}

std::optional<uint64_t> NalScan::damaged_unit() const {
  if (is_other_) return std::nullopt;
  if (!damaged_ && (left_ > 0 || length_bytes_ > 0)) return unit_;
  return damaged_;
}

}  // namespace l4d::io
