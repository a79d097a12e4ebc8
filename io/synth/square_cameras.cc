// SPDX-License-Identifier: Apache-2.0
#include "io/synth/square.h"
#include "io/synth/surface.h"

namespace l4d::io::synth {
namespace {

View ring(double turns) {
  const double s = sin_turns(turns), c = cos_turns(turns);
  return {{8.4 * s, 4.0 - c, 0.7 + 6.8 * c}, {0.2 - 1.5 * s, 1.7, -0.8 - 1.5 * c}, 50};
}

}  // namespace

const Views& square_views() {
  static constexpr Views kViews{{{{-1.5, 2.6, 13.4}, {0.3, 3.15, -3.0}, 40},
                                 {{-3.6, 1.8, 8.8}, {1.9, 2.6, -3.4}, 46},
                                 {{5.4, 2.2, 9.4}, {-2.0, 2.4, -3.4}, 46},
                                 {{0.9, 1.65, 6.6}, {1.3, 1.45, 0.0}, 48},
                                 {{3.6, 1.6, 3.0}, {3.7, 1.9, -3.0}, 50},
                                 {{-3.4, 1.6, 2.3}, {-3.7, 1.5, -1.5}, 46},
                                 {{0.5, 11.5, 17.5}, {0.3, 0.8, -3.0}, 42},
                                 {{1.0, 2.0, -7.4}, {-0.5, 2.6, 6.0}, 50}},
                                ring,
                                {{-1.5, 2.6, 13.4},
                                 {-0.4, 2.1, 9.5},
                                 {0.9, 1.8, 6.0},
                                 {0.4, 1.7, 2.0},
                                 {-1.0, 1.75, -2.0},
                                 {-0.9, 1.8, -3.6}},
                                {{0.3, 3.15, -3.0},
                                 {0.6, 2.5, -3.0},
                                 {0.2, 1.9, -4.0},
                                 {-2.6, 1.8, -4.0},
                                 {2.5, 1.9, -5.0},
                                 {4.5, 2.0, -2.5}},
                                46};
  return kViews;
}

}  // namespace l4d::io::synth
