// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/clock.h"

#include <algorithm>
#include <cmath>

namespace l4d::playback {
namespace {

constexpr double kAfterWait = 1, kAfterWaits = 2;  // seconds that must be ready then
constexpr double kManyWaitsWithin = 30;            // three of them

}  // namespace

void Clock::set_rate(double value) {
  if ((value < 0) != (rate < 0)) position.direction = -position.direction;
  rate = value;
}

Clock::Stop Clock::step(double now, double ready, double border) {
  const double elapsed = std::max(now - anchor_now_, 0.0);
  if (motion == L4D_MOTION_WAITING) waited_ += elapsed;
  if (motion != L4D_MOTION_PLAYING || speed() == 0) {
    anchor_now_ = std::max(now, anchor_now_);
    return Stop::kNow;
  }
  const int direction = position.direction;
  const bool at_border = direction * (ready - border) >= 0;
  const double limit = at_border ? border : ready;
  const double room = std::max(direction * (limit - position.time), 0.0);
  if (elapsed * speed() < room) {
    // Rounding must not take it beyond the limit.
    const double time = position.time + direction * elapsed * speed();
    position.time = direction > 0 ? std::min(time, limit) : std::max(time, limit);
    anchor_now_ = std::max(now, anchor_now_);
    return Stop::kNow;
  }
  if (room > 0) position.time = limit;
  anchor_now_ = std::min(anchor_now_ + room / speed(), std::max(now, anchor_now_));
  return at_border ? Stop::kBorder : Stop::kUnready;
}

double Clock::when(double time) const {
  if (velocity() == 0) return HUGE_VAL;
  return anchor_now_ + std::max((time - position.time) / velocity(), 0.0);
}

void Clock::wait() {
  motion = L4D_MOTION_WAITING;
  ++waits_;
  ++waits_since_start_;
  last_waits_[2] = last_waits_[1];
  last_waits_[1] = last_waits_[0];
  last_waits_[0] = anchor_now_;
}

double Clock::seconds_to_resume(double start_ahead) const {
  if (waits_since_start_ == 0) return start_ahead;
  const bool many = waits_since_start_ >= 3 && anchor_now_ - last_waits_[2] < kManyWaitsWithin;
  return std::max(start_ahead, many ? kAfterWaits : kAfterWait);
}

void Clock::wait_for_start() { waits_since_start_ = 0; }

}  // namespace l4d::playback
