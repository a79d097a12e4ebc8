// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <xxhash.h>

#include <atomic>
#include <cstdint>
#include <memory>

#include "cli/http/folder.h"
#include "cli/http/line.h"

namespace l4d::cli {

// Bytes [begin, end) of a file, over a line. They are those of one state of the file: where it is
// overwritten on the way, the body ends early. A file that grows keeps what was sent, and goes on.
class FileBody {
 public:
  // line and sent (bytes of all bodies) outlive the body.
  FileBody(std::shared_ptr<ServedFile> file, uint64_t begin, uint64_t end, Line& line,
           std::atomic<uint64_t>& sent);
  uint64_t size() const { return end_ - begin_; }
  // The next bytes, at most n: how many, or 0 to cut the connection. Called by one thread at a
  // time, until size() bytes have come.
  size_t read(char* to, size_t n);

 private:
  bool is_as_sent();
  bool holds_what_was_sent(uint64_t digest) const;

  const std::shared_ptr<ServedFile> file_;
  const uint64_t begin_, end_;
  Line& line_;
  std::atomic<uint64_t>& sent_;
  uint64_t at_;
  FileState state_;  // when the file was known to hold what was sent
  std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> hash_;  // of what was sent
};

}  // namespace l4d::cli
