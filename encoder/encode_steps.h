// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>
#include <vector>

#include "encoder/layer/coder_options.h"
#include "l4d/encode.h"

namespace l4d {

// Times the steps of an encode and tells the caller about them. All but cancelled() is for the
// thread that made it.
class EncodeSteps {
 public:
  // total: the work of all steps.
  EncodeSteps(l4d_progress_fn fn, void* user, uint64_t total)
      : fn_(fn), user_(user), total_(total) {}

  void begin(const char* name) {
    end();
    name_ = name;
    started_ = Clock::now();
    report(done_);
  }
  void end() {
    if (name_ == nullptr) return;
    const double seconds = std::chrono::duration<double>(Clock::now() - started_).count();
    const auto same = std::find_if(steps_.begin(), steps_.end(),
                                   [&](const auto& s) { return std::strcmp(s.name, name_) == 0; });
    if (same == steps_.end()) {
      steps_.push_back({name_, seconds});
    } else {
      same->seconds += seconds;
    }
    name_ = nullptr;
  }
  void advance(uint64_t work) { done_ += work; }
  void report(uint64_t done) {
    if (cancelled(done)) throw Cancelled();
  }
  // Called now and then inside long loops, which then return early with what they have. One nonzero
  // answer of the callback is enough: the next report ends the call.
  // Other threads than the caller's do not ask, and learn what it has answered.
  bool cancelled() {
    return std::this_thread::get_id() == caller_ ? cancelled(done_) : cancelled_.load();
  }
  std::vector<l4d_encode_step> take() { return std::move(steps_); }

 private:
  using Clock = std::chrono::steady_clock;

  bool cancelled(uint64_t done) {
    if (!cancelled_ && fn_ != nullptr && name_ != nullptr) {
      cancelled_ = fn_(user_, done, total_, name_) != 0;
    }
    return cancelled_;
  }

  const std::thread::id caller_ = std::this_thread::get_id();
  l4d_progress_fn fn_;
  void* user_;
  uint64_t total_;
  const char* name_ = nullptr;
  Clock::time_point started_;
  uint64_t done_ = 0;
  std::atomic<bool> cancelled_{false};
  std::vector<l4d_encode_step> steps_;
};

}  // namespace l4d
