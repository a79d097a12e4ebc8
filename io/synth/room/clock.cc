// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

const Stand kClock({1.86, 0, kRoomLow[2] + 0.02}, 0);
constexpr double kDeep = 0.27, kDial = 1.80;

// A thin bar on the dial from its middle: `turns` from twelve, clockwise.
void hand(Place& place, double turns, double long_, double wide) {
  const Vec3 way{sin_turns(turns), cos_turns(turns), 0};
  const Vec3 across = cross(kFront, way);
  place.put(
      kClock(slab(place, Vec3{0, kDial, kDeep + 0.028} - across * (wide / 2) * -1 - way * 0.02, way,
                  across * -1, long_, wide, 0.03)),
      [](Dot& d) {
        d.albedo = {0.02, 0.018, 0.015};
        if (d.n[2] < 0) d.n = d.n * -1;
      });
}

void body(Place& place) {
  const auto board = [&](const Vec3& low, const Vec3& high, size_t grain = 1) {
    put_wood(place, kClock(crate(place, low, high, 0.04)), kWalnut * 1.5, grain, 901, 0.5);
  };
  board({-0.25, 0, 0}, {0.25, 0.50, kDeep});
  board({-0.27, 0.50, 0}, {0.27, 0.54, kDeep + 0.02}, 0);
  // The trunk is open in front: two sides, a back, and the pendulum between.
  board({-0.20, 0.54, 0}, {-0.13, 1.50, kDeep - 0.03});
  board({0.13, 0.54, 0}, {0.20, 1.50, kDeep - 0.03});
  board({-0.13, 1.42, 0}, {0.13, 1.50, kDeep - 0.03}, 0);
  board({-0.13, 0.54, 0}, {0.13, 0.60, kDeep - 0.03}, 0);
  place.put(kClock(place.rectangle({-0.13, 0.60, 0.03}, kRight, kUp, 0.26, 0.82, 0.05)),
            kWalnut * 0.5);
  board({-0.27, 1.50, 0}, {0.27, 1.54, kDeep + 0.02}, 0);
  board({-0.25, 1.54, 0}, {0.25, 2.06, kDeep});
  board({-0.28, 2.06, 0}, {0.28, 2.11, kDeep + 0.03}, 0);
  const Patch arch = place.rectangle({-0.26, 2.10, kDeep - 0.02}, kRight, kUp, 0.52, 0.16, 0.03);
  put_wood(place,
           kClock(kept(arch, [](const Dot& d) { return radius_of(d.a - 0.26, d.b * 1.7) < 0.26; })),
           kWalnut * 1.6, 0, 902);
  place.put(
      kClock(with_thickness(place.ball({0, 2.29, kDeep - 0.02}, {0.035, 0.04, 0.035}, 0.02), 0.3)),
      kBrass);
  // The dial: a ring of brass, hours on cream.
  constexpr double kR = 0.20;
  const Patch face =
      place.rectangle({-kR, kDial - kR, kDeep + 0.012}, kRight, kUp, 2 * kR, 2 * kR, 0.0175, 0.1);
  place.put(kClock(kept(face, [](const Dot& d) { return radius_of(d.a - kR, d.b - kR) < kR; })),
            [](Dot& d) {
              const double x = d.a - kR, y = d.b - kR, r = radius_of(x, y);
              d.albedo = r > 0.180 ? kBrass : Vec3{0.62, 0.56, 0.42};
              d.gloss = r > 0.180 ? 0.7 : 0.1;
            });
  for (int k = 0; k < 12; ++k) {
    const Vec3 way{sin_turns(k / 12.0), cos_turns(k / 12.0), 0};
    Dot d;
    d.p = Vec3{0, kDial, kDeep + 0.018} + way * 0.152;
    d.u = way;
    d.v = cross(kFront, way);
    d.n = kFront;
    d.su = 0.013;
    d.sv = 0.0045;
    place.put({kClock.moved(d)}, Vec3{0.03, 0.025, 0.02});
  }
  hand(place, 0.82, 0.12, 0.014);
  hand(place, 0.84, 0.16, 0.010);
  solid(place, kClock, {-0.25, 0, 0}, {0.25, 0.52, kDeep}, kWalnut);
  solid(place, kClock, {-0.20, 0.52, 0}, {-0.13, 1.52, kDeep - 0.03}, kWalnut);
  solid(place, kClock, {0.13, 0.52, 0}, {0.20, 1.52, kDeep - 0.03}, kWalnut);
  solid(place, kClock, {-0.25, 1.52, 0}, {0.25, 2.10, kDeep}, kWalnut);
}

}  // namespace

void make_clock(Place& place) {
  place.still([&] { body(place); });
  if (!place.rigid && !place.is_static) return;
  const Vec3 pivot{0, 1.46, 0.12};
  Patch pendulum = place.tube(pivot, pivot - kUp * 0.62, 0.007, 0.007, 0.03);
  append(pendulum, place.ball(pivot - kUp * 0.66, {0.075, 0.075, 0.018}, 0.017));
  const auto pose = [&](const Dot& d, double t) {
    const double turns = 0.012 * sin_turns(0.6 * t);
    const double c = cos_turns(turns), s = sin_turns(turns);
    const auto swung = [&](const Vec3& v) {
      return Vec3{c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]};
    };
    Dot out = d;
    out.p = swung(d.p - pivot) + pivot;
    out.u = swung(d.u);
    out.v = swung(d.v);
    out.n = swung(d.n);
    return kClock.moved(out);
  };
  const auto brass = [](Dot& d) {
    d.albedo = kBrass * 1.2;
    d.emit = {0.05, 0.03, 0.008};
    d.gloss = 0.7;
    d.thin = 0.3;
  };
  if (place.rigid) {
    place.chain(pendulum, 0.14, 0.6, pose, brass);
    return;
  }
  for (Dot& d : pendulum) d = pose(d, 0);
  place.put(pendulum, brass);
}

}  // namespace l4d::io::synth
