// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <mutex>

namespace l4d::cli {

// All answers share one line of a given speed. For any thread.
class Line {
 public:
  Line(double megabits, uint32_t delay_ms) : megabits_(megabits), delay_(delay_ms) {}
  // Waits for as long as an answer takes to begin. false: the line has been cut.
  bool begin() {
    std::unique_lock<std::mutex> lock(mutex_);
    return wait(lock, Clock::now() + delay_);
  }
  // Waits until n more bytes have passed. false: the line has been cut.
  bool pass(size_t n) {
    std::unique_lock<std::mutex> lock(mutex_);
    if (!(megabits_ > 0)) return !cut_;
    // A year is for ever, and still a time that the clock can count to.
    const double seconds = std::min(8.0 * static_cast<double>(n) / (megabits_ * 1e6), 3e7);
    free_ = std::max(free_, Clock::now()) +
            std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
    return wait(lock, free_);
  }
  // Ends all waiting, for good.
  void cut() {
    const std::lock_guard<std::mutex> lock(mutex_);
    cut_ = true;
    changed_.notify_all();
  }

 private:
  using Clock = std::chrono::steady_clock;
  bool wait(std::unique_lock<std::mutex>& lock, Clock::time_point until) {
    return !changed_.wait_until(lock, until, [&] { return cut_; });
  }

  const double megabits_;
  const std::chrono::milliseconds delay_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool cut_ = false;
  Clock::time_point free_;
};

}  // namespace l4d::cli
