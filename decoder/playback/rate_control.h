// SPDX-License-Identifier: Apache-2.0
// How much of a stream to fetch, from what was measured of a link and what is buffered. It chooses
// a rung of the stream's ladder: its tiers one by one in base colours, then all of it in full
// detail. Times are the caller's, in seconds.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

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

// What of a rung is here.
struct RungState {
  double buffered = 0;  // seconds from the instant on that lack nothing; infinity: to the end
  uint64_t missing_bytes = 0;
};

struct RateOptions {
  double ahead = 6;             // seconds after the instant that states of rungs are for
  double up_buffer = 4;         // the choice goes up only while more seconds are buffered
  double start_throughput = 0;  // bytes per second before the first transfer; 0: unknown
};

// Which requests under way are to be cancelled: their bytes come too late.
enum class RateCancel {
  kNone,
  kDetail,      // those of SH chunks
  kAllButBase,  // all but those that rung 0 needs
};

struct RateChoice {
  uint32_t rung = 0;       // to request and to show
  uint32_t fill_rung = 0;  // to request with what the link has left: `rung`, or the one above it
  RateCancel cancel = RateCancel::kNone;
  uint64_t merge_gap = 0;        // ranges this close are worth one request
  uint64_t max_range_bytes = 0;  // of a request, so that cancelling helps
  double throughput = 0;         // bytes per second, as measured; 0: unknown
  double round_trip = 0;         // seconds; 0: unknown
};

class RateControl {
 public:
  // num_rungs: 1 or more.
  RateControl(const RateOptions& options, uint32_t num_rungs)
      : options_(options), num_rungs_(num_rungs) {}

  const RateOptions& options() const { return options_; }
  uint32_t num_rungs() const { return num_rungs_; }
  // What was measured of the link stays.
  void set_num_rungs(uint32_t n) {
    num_rungs_ = n;
    if (rung_ >= n) rung_ = n - 1;
  }
  // Adds a measurement, in the order in which requests end; several may be under way. Times are
  // finite and ascend. The throughput is the mean over the last transfers of 8 KiB or more, the
  // round trip the least of the last ones. What arrives within 50 ms is a burst: it counts by the
  // time since it was requested, or since the answer before.
  void add(double sent, double first_byte, double last_byte, uint64_t bytes);
  // states: [num_rungs], of one instant and `ahead` seconds after it. A rung fits if 0.8 of the
  // throughput brings its missing bytes within its buffered seconds less one, or within one second
  // if that is more; a rung that lacks nothing always fits.
  //  - If the present rung does not fit, the choice goes down at once to the highest one that does.
  //  - It goes up one rung if that fits within three quarters of its time and more than up_buffer
  //    seconds of the present one are buffered, and as far as rungs lack nothing.
  //  - If less than 1 second of the present rung is buffered, it asks to cancel detail. If less
  //  than
  //    0.3 seconds of rung 0 are, it goes down to rung 0 and asks to cancel all else.
  void choose(const RungState* states, RateChoice* out);

 private:
  struct Transfer {
    double seconds = 0;  // in which bytes arrived
    uint64_t bytes = 0;
  };
  double throughput() const;  // bytes per second; 0 = unknown
  double round_trip() const;  // seconds; 0 = unknown
  // Whether the link brings what a rung lacks within a share of the time that it has.
  bool fits(const RungState& state, double share) const;

  RateOptions options_;
  uint32_t num_rungs_;
  uint32_t rung_ = 0;
  LastOf<Transfer, 5> transfers_;
  Transfer small_;  // those too small to tell the throughput, added up
  LastOf<double, 8> round_trips_;
  double busy_until_ = -HUGE_VAL;
};

}  // namespace l4d
