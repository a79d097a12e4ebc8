// SPDX-License-Identifier: Apache-2.0
// handle.hpp: what the C++17 headers of this library share: errors as exceptions, owning handles,
// spans of a caller's arrays, lists.
#ifndef L4D_HANDLE_HPP
#define L4D_HANDLE_HPP

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "l4d/l4d.h"

namespace l4d {

class Error : public std::runtime_error {
 public:
  Error(l4d_status status, const std::string& detail)
      : std::runtime_error(std::string(l4d_status_name(status)) +
                           (detail.empty() ? "" : ": " + detail)),
        status_(status) {}
  l4d_status status() const noexcept { return status_; }

 private:
  l4d_status status_;
};

// Throws what the last call on this thread returned, unless it is L4D_OK.
inline void require_ok(l4d_status status) {
  if (status != L4D_OK) throw Error(status, l4d_last_error_message());
}

// Owns what a create function made.
template <typename T, void (*kDestroy)(T*)>
class Handle {
 public:
  T* get() const noexcept { return handle_.get(); }
  static void check(l4d_status status) { require_ok(status); }

 protected:
  // create(T** out) returns a status.
  template <typename Create>
  explicit Handle(const Create& create) {
    T* made = nullptr;
    check(create(&made));
    handle_.reset(made);
  }

 private:
  struct Destroy {
    void operator()(T* handle) const noexcept { kDestroy(handle); }
  };
  std::unique_ptr<T, Destroy> handle_;
};

// Elements that somebody else owns. Vectors and arrays turn into a view of theirs.
template <typename T>
class ArrayView {
 public:
  constexpr ArrayView() noexcept = default;
  constexpr ArrayView(T* data, size_t size) noexcept : data_(data), size_(size) {}
  template <typename Container, typename = std::enable_if_t<std::is_convertible_v<
                                    decltype(std::declval<Container&>().data()), T*>>>
  constexpr ArrayView(Container&& container) noexcept  // NOLINT: a view of it
      : data_(container.data()), size_(container.size()) {}
  constexpr T* data() const noexcept { return data_; }
  constexpr size_t size() const noexcept { return size_; }
  constexpr bool empty() const noexcept { return size_ == 0; }
  constexpr T* begin() const noexcept { return data_; }
  constexpr T* end() const noexcept { return data_ + size_; }
  constexpr T& operator[](size_t i) const noexcept { return data_[i]; }

 private:
  T* data_ = nullptr;
  size_t size_ = 0;
};

namespace detail {

// The struct that get(T*) fills.
template <typename T, typename Get>
T filled(const Get& get) {
  T out = L4D_INIT(T);
  require_ok(get(&out));
  return out;
}

// The list that get(T* out, uint64_t capacity, uint64_t* count) writes.
template <typename T, typename Get>
std::vector<T> listed(const Get& get) {
  uint64_t count = 0;
  require_ok(get(static_cast<T*>(nullptr), uint64_t{0}, &count));
  std::vector<T> out(static_cast<size_t>(count));
  require_ok(get(out.data(), count, &count));
  out.resize(std::min(out.size(), static_cast<size_t>(count)));
  return out;
}

}  // namespace detail

// As l4d_progress_fn: returns whether the call goes on. An exception ends it, too.
using ProgressFunction = std::function<bool(uint64_t done, uint64_t total, const char* stage)>;

// A progress function that a handle calls for as long as it has it, wherever it moves.
class OwnProgress {
 public:
  // set(l4d_progress_fn, void* user) returns a status.
  template <typename Set>
  void set(ProgressFunction progress, const Set& set) {
    auto next = progress ? std::make_unique<ProgressFunction>(std::move(progress)) : nullptr;
    require_ok(set(next ? &call : nullptr, next.get()));
    progress_ = std::move(next);
  }

 private:
  static int call(void* user, uint64_t done, uint64_t total, const char* stage) {
    try {
      return (*static_cast<ProgressFunction*>(user))(done, total, stage) ? 0 : 1;
    } catch (...) {
      return 1;
    }
  }
  std::unique_ptr<ProgressFunction> progress_;
};

}  // namespace l4d
#endif  // L4D_HANDLE_HPP
