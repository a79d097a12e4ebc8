// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

constexpr Vec3 kHub{-0.15, 2.36, 0.25};
constexpr double kTurns = 0.16, kPiece = 0.26;  // turns a second, seconds

// About the origin, at rest.
Patch blades(const Place& place) {
  Patch out;
  for (int k = 0; k < 5; ++k) {
    const double turns = k / 5.0;
    const auto way = [&](const Vec3& v) { return turn_y(v, turns); };
    const Vec3 along = way(kRight), across = way(unit({0, 0.2, 1}));
    const Vec3 corner = way({0.16, -0.012, -0.07});
    append(out, threads(place, corner, across, along, 0.145, 0.60, 0.036, 3));
    Patch below = threads(place, corner - kUp * 0.012, across, along, 0.145, 0.60, 0.036, 3);
    turn_over(below);
    append(out, below);
    append(out, with_thickness(
                    place.tube(way({0.06, 0, 0}), way({0.2, -0.005, 0}), 0.014, 0.014, 0.03), 0.5));
  }
  append(out, with_thickness(turned(place, {0, -0.07, 0},
                                    {{0.05, 0}, {0.09, 0.03}, {0.09, 0.10}, {0.04, 0.13}}, 0.03),
                             0.3));
  return out;
}

}  // namespace

void make_fan(Place& place) {
  place.still([&] {
    place.put(with_thickness(place.tube(kHub + kUp * 0.05, {kHub[0], kRoomHigh[1] - 0.17, kHub[2]},
                                        0.014, 0.014, 0.05),
                             0.5),
              kBrass * 0.6);
    place.put(with_thickness(place.tube({kHub[0], kRoomHigh[1] - 0.22, kHub[2]},
                                        {kHub[0], kRoomHigh[1] - 0.17, kHub[2]}, 0.05, 0.065, 0.03),
                             0.3),
              kBrass * 0.6);
    // A globe of milky glass.
    const Vec3 lamp = kHub - kUp * 0.16;
    place.put(with_thickness(place.ball(lamp, {0.10, 0.09, 0.10}, 0.028), 0.15), [](Dot& d) {
      d.emit = Vec3{1.25, 0.90, 0.52} * (0.85 - 0.35 * d.b);
      d.kind = Kind::kUnshaded;
      d.opacity = 0.985;
    });
    place.put({glow(lamp, 0.24, 0.07, kWarm * 1.2)}, [](Dot&) {});
    if (!place.counting) place.light.lamps.push_back({lamp, 0.75, {}, true, kWarm, 0.12});
  });
  const auto paint = [&](Dot& d) {
    d.albedo = length(d.p - kHub) > 0.15 ? Vec3{0.30, 0.16, 0.075} : kBrass * 0.6;
  };
  const auto pose = [](Dot d, double t) {
    d.p = turn_y(d.p, kTurns * t) + kHub;
    d.u = turn_y(d.u, kTurns * t);
    d.v = turn_y(d.v, kTurns * t);
    d.n = cross(d.u, d.v);
    return d;
  };
  if (!place.windows && !place.rigid && !place.is_static) return;
  Patch body = blades(place);
  if (place.windows) {
    place.chain_of_frames(body, kPiece, pose, paint);
  } else if (place.rigid) {
    place.chain(body, kPiece, 0.56, pose, paint);
  } else {
    for (Dot& d : body) d = pose(d, 0.3);
    place.put(body, paint);
  }
}

}  // namespace l4d::io::synth
