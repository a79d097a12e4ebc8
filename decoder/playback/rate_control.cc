// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/rate_control.h"

#include <algorithm>
#include <cmath>

namespace l4d {
namespace {

constexpr uint64_t kTellingBytes = 8 << 10;  // of a transfer that tells the throughput
// What comes within so many seconds was held up somewhere, and says nothing of the link.
constexpr double kBurstSeconds = 0.05;
constexpr double kTrusted = 0.8;     // of the measured throughput
constexpr double kReserve = 1;       // seconds that stay buffered
constexpr double kLeastSeconds = 1;  // to fetch what is missing
// Of the time that a rung has: what has just fitted still fits when a little more is missing.
constexpr double kUpShare = 0.75;
constexpr double kCancelDetail = 1, kCancelAll = 0.3;  // seconds buffered
constexpr uint64_t kLeastGap = 4 << 10, kDefaultGap = 16 << 10, kMostGap = 64 << 10;
constexpr uint64_t kLeastRange = 64 << 10, kMostRange = 1 << 20;
constexpr double kRangeSeconds = 0.5;  // that a request may take, so that cancelling helps

uint64_t clamped(double value, uint64_t least, uint64_t most) {
  return static_cast<uint64_t>(
      std::clamp(value, static_cast<double>(least), static_cast<double>(most)));
}

}  // namespace

void RateControl::add(double sent, double first_byte, double last_byte, uint64_t bytes) {
  round_trips_.add(first_byte - sent);
  // Where several are under way, each second counts once.
  const bool burst = bytes >= kTellingBytes && last_byte - first_byte < kBurstSeconds;
  const double begin = std::max(burst ? sent : first_byte, busy_until_);
  busy_until_ = std::max(busy_until_, last_byte);
  small_.seconds += std::max(last_byte - begin, 0.0);
  small_.bytes += bytes;
  if (small_.seconds <= 0 && !transfers_.empty()) {
    transfers_.back().bytes += small_.bytes;
    small_ = {};
  }
  if (small_.bytes < kTellingBytes || small_.seconds <= 0) return;
  transfers_.add(small_);
  small_ = {};
}

double RateControl::throughput() const {
  double bytes = 0, seconds = 0;
  for (const Transfer& t : transfers_) {
    bytes += static_cast<double>(t.bytes);
    seconds += t.seconds;
  }
  return seconds > 0 ? bytes / seconds : options_.start_throughput;
}

double RateControl::round_trip() const {
  return round_trips_.empty() ? 0 : *std::min_element(round_trips_.begin(), round_trips_.end());
}

bool RateControl::fits(const RungState& state, double share) const {
  const double seconds = share * std::max(state.buffered - kReserve, kLeastSeconds);
  return state.missing_bytes == 0 ||
         static_cast<double>(state.missing_bytes) <= kTrusted * throughput() * seconds;
}

void RateControl::choose(const RungState* states, RateChoice* out) {
  const uint32_t last = num_rungs_ - 1;
  while (rung_ > 0 && !fits(states[rung_], 1)) --rung_;
  if (rung_ < last && states[rung_].buffered > options_.up_buffer &&
      fits(states[rung_ + 1], kUpShare)) {
    ++rung_;
  }
  while (rung_ < last && states[rung_ + 1].missing_bytes == 0) ++rung_;
  const auto is_short = [&](uint32_t rung, double seconds) {
    return states[rung].missing_bytes > 0 && states[rung].buffered < seconds;
  };
  out->cancel = is_short(rung_, kCancelDetail) ? RateCancel::kDetail : RateCancel::kNone;
  if (is_short(0, kCancelAll)) {
    rung_ = 0;
    out->cancel = RateCancel::kAllButBase;
  }
  out->rung = rung_;
  const bool has_all = states[rung_].missing_bytes == 0;
  out->fill_rung = has_all && rung_ < last ? rung_ + 1 : rung_;
  const double rate = throughput();
  out->throughput = rate;
  out->round_trip = round_trip();
  const bool known = rate > 0 && out->round_trip > 0;
  out->merge_gap = known ? clamped(rate * out->round_trip / 4, kLeastGap, kMostGap) : kDefaultGap;
  out->max_range_bytes =
      rate > 0 ? clamped(rate * kRangeSeconds, kLeastRange, kMostRange) : kMostRange;
}

}  // namespace l4d
