// SPDX-License-Identifier: Apache-2.0
#include "io/synth/room/room.h"
#include "io/synth/surface.h"

namespace l4d::io::synth {
namespace {

// Along the walls, looking across.
View ring(double turns) {
  const double s = sin_turns(turns), c = cos_turns(turns);
  return {{2.45 * s, 1.55 + 0.25 * c, 0.75 + 1.45 * c}, {-0.9 * s, 1.05, -0.1 - 0.9 * c}, 62};
}

}  // namespace

const Views& room_views() {
  // The whole; from the window; the hearth; the table; the desk; the window; from below the
  // ceiling; back to the door.
  static constexpr Views kViews{{{{2.35, 1.66, 2.95}, {-0.80, 1.0, -1.5}, 56},
                                 {{-2.0, 1.6, 2.6}, {0.9, 1.0, -1.6}, 56},
                                 {{0.75, 1.15, 0.9}, {0.1, 0.85, -2.6}, 56},
                                 {{0.85, 1.05, 1.75}, {0.05, 0.5, 0.45}, 46},
                                 {{0.6, 1.45, 1.0}, {3.2, 0.95, 0.45}, 50},
                                 {{-0.9, 1.5, 0.4}, {-3.4, 1.5, 0.05}, 58},
                                 {{2.55, 2.5, 2.95}, {-0.75, 0.35, -0.75}, 62},
                                 {{-0.4, 1.6, -2.0}, {0.1, 1.1, 3.2}, 60}},
                                ring,
                                {{2.35, 1.66, 2.95},
                                 {2.0, 1.6, 2.45},
                                 {1.1, 1.45, 1.9},
                                 {-0.4, 1.35, 1.75},
                                 {-1.5, 1.4, 1.2},
                                 {-1.9, 1.5, 0.7}},
                                {{-0.80, 1.0, -1.5},
                                 {-0.5, 1.0, -1.6},
                                 {-0.2, 0.9, -1.6},
                                 {0.0, 0.8, -1.6},
                                 {0.5, 0.8, -1.6},
                                 {1.2, 1.0, -1.4}},
                                56};
  return kViews;
}

}  // namespace l4d::io::synth
