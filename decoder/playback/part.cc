// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/part.h"

#include <cmath>

#include "libl4dcodec/scene/timeline.h"

namespace l4d::playback {

void Part::begin(uint64_t file_size) {
  decoder.close();
  ledger.clear();
  map.open(file_size);
  sequence = {-HUGE_VAL, HUGE_VAL};
  version = 0;
  no_ranges = guesses_size = false;
  failures = losses = 0;
  lost = L4D_CAUSE_NONE;
}

void Part::set_open() {
  const Sequence all = sequence_of(decoder.file().header().timeline);
  sequence = {all.begin, all.end};
  losses = 0;
}

double Part::last_at(double time) const {
  double at = time + entry.shift;
  while (at - entry.shift > time) at = std::nextafter(at, -HUGE_VAL);
  return at;
}

double Part::first_at(double time) const {
  double at = time + entry.shift;
  while (at - entry.shift < time) at = std::nextafter(at, HUGE_VAL);
  return at;
}

}  // namespace l4d::playback
