// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/path.h"

#include <algorithm>
#include <cmath>

namespace l4d::playback {

bool Path::turn(Position* position) const {
  if (mode_ == L4D_PLAY_ONCE || !(end_ > begin_)) return false;
  if (grows_ && position->direction > 0) return false;
  if (mode_ == L4D_PLAY_LOOP) {
    position->time = position->direction < 0 ? end_ : begin_;
  } else {
    position->time = border(*position);
    position->direction = -position->direction;
  }
  return true;
}

void Path::segments(Position position, double length, std::vector<Segment>* out) const {
  out->clear();
  // Once around, everything has been named.
  const double around = (mode_ == L4D_PLAY_PING_PONG ? 2 : 1) * (end_ - begin_);
  if (mode_ != L4D_PLAY_ONCE) length = std::min(length, around);
  double at = 0;
  while (true) {
    const double end = position.direction < 0 ? begin_ : end_;
    // A position outside the range is beyond the border: an instant.
    const double room = std::max(position.direction * (end - position.time), 0.0);
    const double some = std::min(room, length - at);
    out->push_back({position.time, position.time + position.direction * some, at});
    at += some;
    if (some < room || at >= length || !turn(&position)) return;
  }
}

}  // namespace l4d::playback
