// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace l4d::eval {

// Counts memory that an evaluation takes because of a stream. Called before `what` of `bytes` is
// allocated; the evaluation keeps what it returns as long as that memory. It throws if the bytes do
// not fit. Empty: nothing is counted.
using Hold = std::function<std::shared_ptr<void>(uint64_t bytes, const std::string& what)>;

inline std::shared_ptr<void> hold(const Hold& holder, uint64_t bytes, const std::string& what) {
  return holder ? holder(bytes, what) : nullptr;
}

}  // namespace l4d::eval
