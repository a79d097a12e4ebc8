// SPDX-License-Identifier: Apache-2.0
// The time of the presentation: an anchor, and how fast it moves from there. It never leaves what
// can be shown while it moves.
#pragma once

#include <cstdint>

#include "decoder/playback/path.h"
#include "l4d/playback.h"

namespace l4d::playback {

class Clock {
 public:
  // What ended a step.
  enum class Stop { kNow, kBorder, kUnready };

  Position position;
  double rate = 1;    // as the caller set it
  double factor = 1;  // of it, to keep a distance
  uint32_t motion = L4D_MOTION_PAUSED;

  double anchor_now() const { return anchor_now_; }
  void set_anchor(double now) { anchor_now_ = now; }
  double speed() const { return (rate < 0 ? -rate : rate) * factor; }
  double velocity() const {
    return motion == L4D_MOTION_PLAYING ? speed() * position.direction : 0;
  }
  double waited() const { return waited_; }
  uint64_t waits() const { return waits_; }

  // A rate of the other sign turns the direction.
  void set_rate(double value);
  // Moves towards `now`, at most to `ready` and `border`, which lie in the direction of play.
  Stop step(double now, double ready, double border);
  // When `time` is reached; infinity: never.
  double when(double time) const;
  // Stops for bytes.
  void wait();
  // Seconds of `now` that have to be ready before playback goes on.
  double seconds_to_resume(double start_ahead) const;
  // A seek or a command to play begins anew: the first wait is not one of the link.
  void wait_for_start();

 private:
  double anchor_now_ = 0;
  double waited_ = 0;
  uint64_t waits_ = 0;
  uint32_t waits_since_start_ = 0;
  double last_waits_[3] = {-1e300, -1e300, -1e300};  // when, the newest first
};

}  // namespace l4d::playback
