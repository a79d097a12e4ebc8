// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace l4d::io {

// Counts memory that input makes a process take: `bytes` of `what`, before they are allocated. The
// caller keeps what it returns as long as that memory. It throws Error(L4D_ERR_LIMIT_EXCEEDED) if
// they do not fit. Empty: nothing is counted.
using Hold = std::function<std::shared_ptr<void>(uint64_t bytes, const std::string& what)>;

inline std::shared_ptr<void> hold(const Hold& holder, uint64_t bytes, const std::string& what) {
  return holder ? holder(bytes, what) : nullptr;
}

// Called now and then by what takes long; throws where the caller no longer wants it. May be empty.
using Check = std::function<void()>;

inline void call(const Check& check) {
  if (check) check();
}

// The one budget of a process, from which all that reads input takes. It may be used by several
// threads; what was taken may outlive it.
class MemoryBudget {
 public:
  // name: of the limit, for messages, as "--limit-memory". limit: bytes; 0 = none, and all fits.
  MemoryBudget(std::string name, uint64_t limit);

  // Takes from the budget until the last copy of what it returns is gone.
  std::shared_ptr<void> take(uint64_t bytes, const std::string& what) const;
  // Bytes that are taken.
  uint64_t held() const;
  // take() as a function, which keeps the budget.
  Hold holder() const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

// "1.20 MB"
std::string text_of_bytes(uint64_t bytes);

// Bytes that parsing this JSON takes at most, its text and what `of_object` bytes for each of its
// objects become included. It counts brackets and separators, and parses nothing.
uint64_t json_bytes(const char* text, size_t size, uint64_t of_object);

}  // namespace l4d::io
