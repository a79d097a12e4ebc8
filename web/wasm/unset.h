// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>

namespace l4d::web {

// Numbers that are written after. A vector would set all of them to zero first.
template <typename T>
class Unset {
 public:
  // What was in them is gone where they grow.
  void resize(size_t n) {
    if (n > capacity_) {
      clear();
      data_.reset(new T[n]);
      capacity_ = n;
    }
    size_ = n;
  }

  void clear() {
    data_.reset();
    size_ = capacity_ = 0;
  }

  T* data() const { return data_.get(); }
  size_t size() const { return size_; }

 private:
  std::unique_ptr<T[]> data_;
  size_t size_ = 0;
  size_t capacity_ = 0;
};

}  // namespace l4d::web
