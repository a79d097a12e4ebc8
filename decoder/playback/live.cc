// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/live.h"

#include <algorithm>

namespace l4d::playback {
namespace {

constexpr double kTakeBackSeconds = 60;    // without starvation, after which a step is taken back
constexpr double kMostStaleDelay = 8;      // seconds between two looks at what does not grow
constexpr uint32_t kLooksPerDoubling = 4;  // of the seconds between two of them
constexpr double kEarly = 0.5;             // seconds ahead when the next segment comes

}  // namespace

void Live::close() { *this = Live(options_); }

void Live::add_look(double now, double end, double target_duration, bool complete, bool grown) {
  const bool was_live = grows();
  end_ = end;
  if (!complete || was_live) target_ = target_duration;
  complete_ = complete;
  if (grown) {
    grown_at_ = now;
    starts_.add(now - end);
    looks_ = 0;
    look_at_ = now + target_duration;
  } else {
    add_failed_look(now);
  }
  if (complete) look_at_ = HUGE_VAL;
}

void Live::add_failed_look(double now) {
  const double target = std::max(target_, 1.0);
  const bool stale = state(now, 0) == L4D_LIVE_STALE;
  looks_ = stale ? std::min(looks_ + 1, 64u) : 0;
  const int doublings = static_cast<int>(looks_ / kLooksPerDoubling);
  const double slower = std::min(std::ldexp(target, doublings), std::max(target, kMostStaleDelay));
  look_at_ = now + (stale ? slower : target / 2);
}

void Live::add_starvation(double now) {
  is_starved_ = true;
  const double base = distance(now) - extra_;
  extra_ = std::min(extra_ + target_ / 2, base);
  starved_at_ = now;
  starts_ = {};  // the producer is later than before
}

// Looks find what has grown a while ago; the one that found it first knows best.
double Live::edge(double now) const {
  if (!grows() || starts_.empty()) return end_;
  const double start = *std::min_element(starts_.begin(), starts_.end());
  return std::clamp(now - start, end_, end_ + 1.5 * target_);
}

double Live::distance(double now) const {
  const double base = options_.live_distance > 0 ? options_.live_distance : 2 * target_;
  const double steps = std::floor(std::max(now - starved_at_, 0.0) / kTakeBackSeconds);
  return base + std::max(extra_ - steps * target_ / 2, 0.0);
}

double Live::max_distance(double now) const {
  const double most = options_.max_live_distance > 0 ? options_.max_live_distance : 10 * target_;
  return std::max(most, distance(now) + 2 * target_);
}

double Live::live_time(double now) const {
  return std::min(edge(now) - distance(now), end_ - kEarly);
}

double Live::seconds_to_resume(double now) const {
  return options_.live_slow < 1 ? target_ + kEarly
                                : std::max(distance(now) - target_ / 2, target_ + kEarly);
}

// It has reached the distance before it changes its mind.
double Live::factor(double now, double time) {
  const double behind = delay(now, time) - distance(now);
  if (!grows())
    factor_ = 1;
  else if (behind > target_ / 2)
    factor_ = options_.live_fast;
  else if (behind < -target_ / 2)
    factor_ = options_.live_slow;
  else if ((factor_ > 1 && behind <= 0) || (factor_ < 1 && behind >= 0))
    factor_ = 1;
  return factor_;
}

double Live::next_time(double now) const {
  if (!grows()) return HUGE_VAL;
  const double stale = options_.stale_after > 0 ? options_.stale_after : std::max(3 * target_, 6.0);
  const double at = grown_at_ + stale;
  return at > now ? at : HUGE_VAL;
}

uint32_t Live::state(double now, double time) const {
  if (target_ == 0) return L4D_LIVE_NONE;
  if (complete_) return L4D_LIVE_ENDED;
  if (restarted_) return L4D_LIVE_RESTARTED;
  const double stale = options_.stale_after > 0 ? options_.stale_after : std::max(3 * target_, 6.0);
  if (now - grown_at_ >= stale) return L4D_LIVE_STALE;
  return delay(now, time) > distance(now) + target_ ? L4D_LIVE_BEHIND : L4D_LIVE_ON_TIME;
}

}  // namespace l4d::playback
