// SPDX-License-Identifier: Apache-2.0
#include "io/synth/room/room.h"

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

void build(Place& place) {
  place.light.ambience = {false, {0.120, 0.094, 0.074}, {0.085, 0.060, 0.041}, {}, 1.1, 0.3};
  // What stands still also stops light and has the lamps; so it is made even if it is not shown.
  place.still([&] {
    make_shell(place);
    make_walls(place);
    make_shelves(place);
    make_pictures(place);
    make_rug(place);
    make_armchair(place);
    make_desk(place);
    make_plants(place);
  });
  make_window(place);
  make_hearth(place);
  make_table(place);
  make_clock(place);
  make_fan(place);
  make_rocker(place);
  make_cat(place);
}

}  // namespace

Scene make_living_room(const SynthOptions& options) {
  const Design room{250000, kRoomLow, kRoomHigh, room_views().named[0], build};
  return make_place(room, options);
}

}  // namespace l4d::io::synth
