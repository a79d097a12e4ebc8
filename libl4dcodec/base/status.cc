// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/base/status.h"

namespace l4d {

std::string Status::detail() const {
  std::string text;
  if (clause_[0] != '\0') {
    text += "spec ";
    text += clause_;
  }
  if (offset_ != kNoOffset) {
    text += text.empty() ? "at byte " : " at byte ";
    text += std::to_string(offset_);
  }
  if (!text.empty()) text += ": ";
  return text + message_;
}

}  // namespace l4d
