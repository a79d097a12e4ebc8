// SPDX-License-Identifier: Apache-2.0
// How much of a stream to fetch, from what was measured of a link and what is buffered (rate.h).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "l4d/rate.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

// The last of what was added, at most N, in order.
template <typename T, size_t N>
class LastOf {
 public:
  void add(const T& value) {
    if (count_ == N) {
      for (size_t k = 1; k < N; ++k) values_[k - 1] = values_[k];
      --count_;
    }
    values_[count_++] = value;
  }
  bool empty() const { return count_ == 0; }
  T& back() { return values_[count_ - 1]; }
  const T* begin() const { return values_.data(); }
  const T* end() const { return values_.data() + count_; }

 private:
  std::array<T, N> values_{};
  size_t count_ = 0;
};

class RateControl {
 public:
  // options: full; num_rungs: 1 or more.
  RateControl(const l4d_rate_options& options, uint32_t num_rungs)
      : options_(options), num_rungs_(num_rungs) {}

  uint32_t num_rungs() const { return num_rungs_; }
  // Times are finite and ascend.
  void add(double sent, double first_byte, double last_byte, uint64_t bytes);
  // states: [num_rungs]
  void choose(const l4d_rung_state* states, l4d_rate_choice* out);

 private:
  struct Transfer {
    double seconds = 0;  // in which bytes arrived
    uint64_t bytes = 0;
  };
  double throughput() const;  // bytes per second; 0 = unknown
  double round_trip() const;  // seconds; 0 = unknown
  // Whether the link brings what a rung lacks within a share of the time that it has.
  bool fits(const l4d_rung_state& state, double share) const;

  l4d_rate_options options_;
  uint32_t num_rungs_;
  uint32_t rung_ = 0;
  LastOf<Transfer, 5> transfers_;
  Transfer small_;  // those too small to tell the throughput, added up
  LastOf<double, 8> round_trips_;
  double busy_until_ = -HUGE_VAL;
};

}  // namespace l4d
