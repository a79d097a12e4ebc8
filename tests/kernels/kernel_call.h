// SPDX-License-Identifier: Apache-2.0
// One call of one kernel with prepared input: run by the checks and by --bench alike.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "decoder/expand/reconstruct.h"
#include "decoder/expand/transform.h"
#include "libl4dcodec/entropy/stream_kernels.h"
#include "tests/common/random.h"

namespace l4d::test {

// The implementations under comparison.
struct Kernels {
  const StreamKernels* stream;
  const ReconstructKernels* reconstruct;
  const TransformKernels* transform;
};
inline Kernels reference_kernels() {
  return {&stream_kernels_reference(), &reconstruct_kernels_reference(),
          &transform_kernels_reference()};
}
// Of the target that dispatch is set to.
inline Kernels simd_kernels() {
  return {&stream_kernels_simd(), &reconstruct_kernels_simd(), &transform_kernels_simd()};
}

enum class Fill { kRandom, kLow, kHigh, kEdges };
constexpr Fill kFills[] = {Fill::kRandom, Fill::kLow, Fill::kHigh, Fill::kEdges};

struct CallOptions {
  size_t n = 0;
  Fill fill = Fill::kRandom;
  size_t offset = 0;  // elements by which arrays are off their alignment
  bool past_cache = false;
  uint64_t seed = 0;
  std::string text() const;
};

// n elements of T at `offset` elements behind a 64-byte boundary, with canaries on both sides.
template <typename T>
class Guarded {
 public:
  Guarded(size_t n, size_t offset)
      : n_(n), bytes_(n * sizeof(T) + offset * sizeof(T) + 4 * kGuard) {
    const uintptr_t at = reinterpret_cast<uintptr_t>(bytes_.data()) + kGuard;
    const uintptr_t aligned = (at + 63) / 64 * 64 + offset * sizeof(T);
    begin_ = static_cast<size_t>(aligned - reinterpret_cast<uintptr_t>(bytes_.data()));
    reset(nullptr);
  }
  T* data() { return reinterpret_cast<T*>(bytes_.data() + begin_); }
  const T* data() const { return reinterpret_cast<const T*>(bytes_.data() + begin_); }
  size_t size() const { return n_; }
  // Canary everywhere, then `content` [n] where given.
  void reset(const T* content) {
    // It repeats every 256 bytes, so that most of it is copied.
    const size_t size = bytes_.size(), first = std::min<size_t>(size, 256);
    for (size_t i = 0; i < first; ++i) bytes_[i] = static_cast<unsigned char>(0xa5 + i * 7);
    for (size_t i = first; i < size; i += first) {
      std::memcpy(bytes_.data() + i, bytes_.data(), std::min(first, size - i));
    }
    if (content != nullptr && n_ > 0) std::memcpy(data(), content, n_ * sizeof(T));
  }
  const std::vector<unsigned char>& all() const { return bytes_; }

 private:
  static constexpr size_t kGuard = 128;
  size_t n_;
  std::vector<unsigned char> bytes_;
  size_t begin_ = 0;
};

// A prepared call.
class Call {
 public:
  virtual ~Call() = default;
  // Resets the outputs and calls. The result: all output bytes with their canaries, and return
  // values.
  virtual std::vector<unsigned char> check(const Kernels& kernels) = 0;
  // The call alone, on whatever the outputs hold.
  virtual void run(const Kernels& kernels) = 0;
  virtual size_t output_bytes() const = 0;
};

struct Operation {
  const char* name;
  std::unique_ptr<Call> (*make)(const CallOptions& options);
};
const std::vector<Operation>& stream_operations();
const std::vector<Operation>& reconstruct_operations();
const std::vector<Operation>& transform_operations();

// A call with one output array.
template <typename T>
class ArrayCall : public Call {
 public:
  using Body = std::function<uint64_t(const Kernels& kernels, T* out)>;
  // content: what the output holds before the call, empty = canary.
  ArrayCall(size_t n, size_t offset, std::vector<T> content, Body body)
      : out_(n, offset), content_(std::move(content)), body_(std::move(body)) {}
  std::vector<unsigned char> check(const Kernels& kernels) override {
    out_.reset(content_.empty() ? nullptr : content_.data());
    const uint64_t result = body_(kernels, out_.data());
    std::vector<unsigned char> all;
    all.reserve(out_.all().size() + 8);  // large blocks are slow to get
    all.insert(all.end(), out_.all().begin(), out_.all().end());
    for (unsigned i = 0; i < 8; ++i) all.push_back(static_cast<unsigned char>(result >> (8 * i)));
    return all;
  }
  void run(const Kernels& kernels) override { body_(kernels, out_.data()); }
  size_t output_bytes() const override { return out_.size() * sizeof(T); }

 private:
  Guarded<T> out_;
  std::vector<T> content_;
  Body body_;
};

// Values of an integer stream of `width` bits.
std::vector<uint16_t> integers(const CallOptions& options, size_t n, unsigned width);
// Finite binary16 bits.
std::vector<uint16_t> halves(const CallOptions& options, size_t n);

}  // namespace l4d::test
