// SPDX-License-Identifier: Apache-2.0
// Helpers of the C entry points: versioned structs, and the border no exception crosses.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstring>
#include <exception>
#include <new>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "libl4dcodec/base/status.h"

namespace l4d::api {

// How many bytes T has at least in every version of this library. A caller's struct is never
// smaller, so one that claims to be was not made by L4D_INIT. Each versioned struct that a
// function takes has a line of L4D_FIRST_VERSION with the last field of its first version; a struct
// without one does not compile.
template <typename T>
struct FirstVersion;
#define L4D_FIRST_VERSION(T, last_field)                                \
  template <>                                                           \
  struct FirstVersion<T> {                                              \
    static constexpr size_t kBytes =                                    \
        offsetof(T, last_field) + sizeof(std::declval<T>().last_field); \
  }

L4D_FIRST_VERSION(l4d_reader, block_bytes);
L4D_FIRST_VERSION(l4d_writer, write);
L4D_FIRST_VERSION(l4d_gaussians, mean_t_double);
L4D_FIRST_VERSION(l4d_rendering, stated);
L4D_FIRST_VERSION(l4d_presentation, metres_per_unit);

template <typename T, typename = void>
struct HasStructSize : std::false_type {};
template <typename T>
struct HasStructSize<T, std::void_t<decltype(std::declval<const T&>().struct_size)>>
    : std::true_type {};

// What is wrong with a struct that a caller may leave out, null if nothing is.
template <typename T>
const char* optional(const T* p) {
  if constexpr (HasStructSize<T>::value) {
    if (p != nullptr && p->struct_size < FirstVersion<T>::kBytes) {
      return "struct_size is below that of the struct's first version: make it with L4D_INIT";
    }
  }
  return nullptr;
}
// What is wrong with the first of the pointers that is not as a function needs it, null if nothing
// is.
inline const char* required() { return nullptr; }
template <typename T, typename... Rest>
const char* required(const T* p, const Rest*... rest) {
  if (p == nullptr) return "a required pointer is NULL";
  const char* bad = optional(p);
  return bad != nullptr ? bad : required(rest...);
}

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
T read_struct(const T& in, T defaults = {}) {
  const size_t size = std::min(in.struct_size, sizeof(T));
  std::memcpy(static_cast<void*>(&defaults), &in, size);
  defaults.struct_size = sizeof(T);
  return defaults;
}
// The same of one that a caller may leave out.
template <typename T>
T read_optional(const T* in) {
  return in == nullptr ? L4D_INIT(T) : read_struct(*in);
}

// Full structs from an array of a caller's: `count` of them, each as long as the first one says.
// What is wrong with the array, null if nothing is.
template <typename T>
const char* read_array(const T* in, size_t count, std::vector<T>* out) {
  out->clear();
  if (count == 0) return nullptr;
  if (const char* bad = required(in)) return bad;
  const size_t stride = in->struct_size;
  for (size_t i = 0; i < count; ++i) {
    const T& element = *reinterpret_cast<const T*>(reinterpret_cast<const char*>(in) + i * stride);
    if (element.struct_size != stride) {
      return "the elements of an array differ in struct_size: make each with L4D_INIT";
    }
    out->push_back(read_struct(element));
  }
  return nullptr;
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

// Keeps a failure as the last one of the calling thread. Keeping a message must not throw: without
// memory there is none.
inline l4d_status keep_last(const Status& status) noexcept {
  if (status.ok()) return L4D_OK;
  try {
    l4d_keep_error_message_(status.detail().c_str());
  } catch (...) {
    l4d_keep_error_message_("");
  }
  return status.code();
}
inline l4d_status fail(l4d_status code, const char* message) noexcept {
  l4d_keep_error_message_(message);
  return code;
}

// Whether a call on a handle is running, so that its callbacks cannot begin another one.
class Busy {
 public:
  class Scope {
   public:
    explicit Scope(Busy& busy) : busy_(busy), entered_(!busy.flag_.exchange(true)) {}
    ~Scope() {
      if (entered_) busy_.flag_.store(false);
    }
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;
    bool entered() const { return entered_; }

   private:
    Busy& busy_;
    const bool entered_;
  };
  bool is_set() const { return flag_.load(); }

 private:
  std::atomic<bool> flag_{false};
};

inline l4d_status fail_busy() noexcept {
  return fail(L4D_ERR_INVALID_STATE, "the handle serves another call: a callback must not call it");
}
inline l4d_status fail_without_handle() noexcept {
  return fail(L4D_ERR_INVALID_ARGUMENT, "the handle is NULL");
}

// Runs `body` for a call on a handle that has `busy`, and keeps its failure. bad: what is wrong
// with the arguments, or null.
template <typename Handle, typename Body>
l4d_status call_on(Handle* handle, const char* bad, const Body& body) {
  if (handle == nullptr) return fail_without_handle();
  const Busy::Scope scope(handle->busy);
  if (!scope.entered()) return fail_busy();
  return keep_last(guard([&]() -> Status {
    if (bad != nullptr) return invalid_argument(bad);
    return body();
  }));
}
// Whether the handle may be destroyed now.
template <typename Handle>
bool may_destroy(const Handle* handle) {
  if (handle == nullptr) return false;
  if (handle->busy.is_set()) fail_busy();
  return !handle->busy.is_set();
}

}  // namespace l4d::api
