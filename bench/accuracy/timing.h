// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <vector>

namespace l4d::bench {

inline double seconds_now() {  // monotonic
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

// Median seconds of `runs` calls after one that warms up.
template <typename Call>
double time_median(int runs, Call&& call) {
  call();
  std::vector<double> seconds;
  for (int i = 0; i < runs; ++i) {
    const double started = seconds_now();
    call();
    seconds.push_back(seconds_now() - started);
  }
  std::sort(seconds.begin(), seconds.end());
  return seconds[seconds.size() / 2];
}

}  // namespace l4d::bench
