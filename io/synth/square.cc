// SPDX-License-Identifier: Apache-2.0
#include "io/synth/square.h"

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

void build(Place& place) {
  // What stands still also stops light and rays, and has the lamps; so it is made even if it is
  // not shown.
  std::vector<Vec3> chimneys;
  place.still([&] {
    make_ground(place);
    make_houses(place, &chimneys);
    make_trees(place);
    make_stalls(place);
    make_surroundings(place);
  });
  make_lanterns(place);
  make_fountain(place);
  make_gazing_ball(place);
  make_carousel(place);
  make_flag(place);
  make_juggler(place);
  make_walkers(place);
  make_smoke(place, chimneys);
}

}  // namespace

Scene make_square(const SynthOptions& options) {
  const Design square{522000, {-12.5, 0, -9}, {12.5, 11, 13}, square_views().named[0], build};
  return make_place(square, options);
}

}  // namespace l4d::io::synth
