// SPDX-License-Identifier: Apache-2.0
// How far behind the end of a playlist that grows to play, how fast on the way there, and when to
// look at the playlist again.
#pragma once

#include <cmath>
#include <cstdint>

#include "decoder/playback/rate_control.h"
#include "l4d/playback.h"

namespace l4d::playback {

class Live {
 public:
  explicit Live(const l4d_playback_options& options) : options_(options) {}

  void close();
  // A look at the playlist, which now ends at `end`. grown: it is another one than before.
  void add_look(double now, double end, double target_duration, bool complete, bool grown);
  // A look that failed, or at an older playlist.
  void add_failed_look(double now);
  void set_restarted() { restarted_ = true; }
  // Something of the new playlist is shown.
  void set_shown() { restarted_ = false; }
  // Playback has come to the end of the playlist, and waits.
  void add_starvation(double now);
  // What was starved of it takes more than the usual to go on.
  bool is_starved() const { return is_starved_; }
  void set_fed() { is_starved_ = false; }

  bool grows() const { return target_ > 0 && !complete_; }
  double target_duration() const { return target_; }
  // When to look again; infinity: never.
  double look_at() const { return look_at_; }
  // When the state changes, if nothing is new until then; infinity: never.
  double next_time(double now) const;
  // The end that the playlist would have now, if it grew all the time.
  double edge(double now) const;
  double delay(double now, double time) const { return edge(now) - time; }
  // The distance to keep, and from which on to jump.
  double distance(double now) const;
  double max_distance(double now) const;
  // Where to play.
  double live_time(double now) const;
  // Seconds that have to be there after starvation.
  double seconds_to_resume(double now) const;
  // The factor of the rate, of playback that follows the end.
  double factor(double now, double time);
  uint32_t state(double now, double time) const;

 private:
  l4d_playback_options options_;
  double target_ = 0;  // 0: no playlist that grows was seen
  double end_ = 0;
  // When the end of the playlist was at 0, if it had always grown: by each of the last looks.
  LastOf<double, 8> starts_;
  double grown_at_ = 0, look_at_ = HUGE_VAL;
  uint32_t looks_ = 0;  // in a row that found nothing new
  double extra_ = 0;    // of the distance
  double starved_at_ = 0;
  double factor_ = 1;
  bool complete_ = false, restarted_ = false, is_starved_ = false;
};

}  // namespace l4d::playback
