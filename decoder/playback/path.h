// SPDX-License-Identifier: Apache-2.0
// What playback shows next: parts of the presentation, one after the other, each forwards or
// backwards. Reverse, loops and ping-pong are paths like any other.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "l4d/playback.h"

namespace l4d::playback {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

// [from, to] in the direction of play; begins `at` seconds of the presentation along the path.
struct Segment {
  double from = 0, to = 0;
  double at = 0;
  bool forwards() const { return to >= from; }
  double low() const { return forwards() ? from : to; }
  double high() const { return forwards() ? to : from; }
  double length() const { return high() - low(); }
};

// Where playback is, and where it goes: 1 or -1.
struct Position {
  double time = 0;
  int direction = 1;
};

class Path {
 public:
  // begin <= end; mode: L4D_PLAY_*; grows: the end will be a later one.
  void set_range(double begin, double end, uint32_t mode, bool grows = false) {
    begin_ = begin;
    end_ = end;
    mode_ = mode;
    grows_ = grows;
  }
  double begin() const { return begin_; }
  double end() const { return end_; }
  bool grows() const { return grows_; }

  // The path from a position on, `length` seconds long, shorter where playback ends or everything
  // is in it. At least one segment, which may be an instant.
  void segments(Position position, double length, std::vector<Segment>* out) const;
  // Where the segment that contains the position ends; infinity: at an end that grows.
  double border(Position position) const {
    return position.direction < 0 ? begin_ : grows_ ? HUGE_VAL : end_;
  }
  // What follows the border; false: playback ends there.
  bool turn(Position* position) const;

 private:
  double begin_ = 0, end_ = 0;
  uint32_t mode_ = L4D_PLAY_ONCE;
  bool grows_ = false;
};

}  // namespace l4d::playback
