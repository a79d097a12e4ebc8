// SPDX-License-Identifier: Apache-2.0
// Helpers of the C entry points: versioned structs, and the border no exception crosses.
#pragma once

#include <algorithm>
#include <cstring>
#include <exception>
#include <new>
#include <string>
#include <utility>

#include "libl4dcodec/base/status.h"

namespace l4d::api {

// Fills a caller's struct of struct_size bytes with what this version's defaults say.
template <typename T>
void init_struct(T* out, size_t struct_size, T defaults) {
  if (out == nullptr) return;
  defaults.struct_size = struct_size;
  std::memset(static_cast<void*>(out), 0, struct_size);
  std::memcpy(static_cast<void*>(out), &defaults, std::min(struct_size, sizeof(T)));
}

// A full struct from a caller's possibly older one: missing fields keep their defaults.
template <typename T>
T read_struct(const T& in, T defaults) {
  const size_t size = std::min(in.struct_size, sizeof(T));
  std::memcpy(static_cast<void*>(&defaults), &in, size);
  defaults.struct_size = sizeof(T);
  return defaults;
}

// Copies results into a caller's possibly older struct, whose struct_size stays.
template <typename T>
void write_struct(const T& from, T* out) {
  const size_t struct_size = out->struct_size;
  std::memcpy(static_cast<void*>(out), &from, std::min(struct_size, sizeof(T)));
  out->struct_size = struct_size;
}

// Short of memory the status comes without its message.
inline Status internal_error(const char* what) noexcept {
  try {
    return Status(L4D_ERR_INTERNAL, what);
  } catch (...) {
    return Status(L4D_ERR_INTERNAL, std::string());
  }
}

// Runs `body`, which returns a Status, and turns what it throws into one.
template <typename Body>
Status guard(const Body& body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return Status(L4D_ERR_OUT_OF_MEMORY, "out of memory");
  } catch (const std::exception& e) {
    return internal_error(e.what());
  } catch (...) {
    return internal_error("unknown exception");
  }
}

// The last failure of a handle. Keeping a message must not throw: without memory there is none.
class ErrorDetail {
 public:
  l4d_status keep(const Status& status) {
    try {
      detail_ = status.ok() ? std::string() : status.detail();
    } catch (...) {
      detail_.clear();
    }
    return status.code();
  }
  const char* c_str() const { return detail_.c_str(); }

 private:
  std::string detail_;
};

}  // namespace l4d::api
