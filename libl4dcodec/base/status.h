// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "l4d/l4d.h"

namespace l4d {

// The result of every internal operation that can fail: a public status code, and for failures the
// spec clause and the byte offset they concern. It carries a message only on failure, so the
// success path costs one integer.
class [[nodiscard]] Status {
 public:
  static constexpr uint64_t kNoOffset = ~uint64_t{0};

  Status() = default;
  Status(l4d_status code, std::string message) : code_(code), message_(std::move(message)) {}
  Status(l4d_status code, const char* clause, uint64_t offset, std::string message)
      : code_(code), offset_(offset), clause_(clause), message_(std::move(message)) {}

  bool ok() const { return code_ == L4D_OK; }
  l4d_status code() const { return code_; }
  // Id of the violated rule ("PAGE-3"), "" where no rule of the spec is concerned. Static storage.
  const char* clause() const { return clause_; }
  // Byte offset in the file, kNoOffset where none applies.
  uint64_t offset() const { return offset_; }
  const std::string& message() const { return message_; }
  // "spec PAGE-3 at byte 1841: ..." : what the public error message shows.
  std::string detail() const;

 private:
  l4d_status code_ = L4D_OK;
  uint64_t offset_ = kNoOffset;
  const char* clause_ = "";
  std::string message_;
};

// A violated MUST of the spec.
inline Status corrupt(const char* clause, uint64_t offset, std::string message) {
  return Status(L4D_ERR_CORRUPT, clause, offset, std::move(message));
}
inline Status invalid_argument(std::string message) {
  return Status(L4D_ERR_INVALID_ARGUMENT, std::move(message));
}

#define L4D_RETURN_IF_ERROR(expr)              \
  do {                                         \
    ::l4d::Status l4d_status_ = (expr);        \
    if (!l4d_status_.ok()) return l4d_status_; \
  } while (0)

}  // namespace l4d
