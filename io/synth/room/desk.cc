// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

constexpr double kTop = 0.76;
const Stand kDesk({kRoomHigh[0] - 0.36, 0, 0.55}, -0.25);  // its back to the east wall

void table(Place& place) {
  plank(place, kDesk, {-0.74, kTop - 0.035, -0.34}, {0.74, kTop, 0.34}, 0.038, kOak * 1.05, 0, 841,
        0.6);
  place.put(kDesk(place.rectangle({-0.40, kTop + 0.004, 0.28}, kRight, kFront * -1, 0.8, 0.46, 0.04,
                                  0.1)),
            [](Dot& d) {
              d.albedo = {0.045, 0.11, 0.06};  // leather
              d.gloss = 0.3;
            });
  for (const double s : {-1.0, 1.0}) {
    const double x0 = s < 0 ? -0.72 : 0.36, x1 = s < 0 ? -0.36 : 0.72;
    plank(place, kDesk, {x0, 0.05, -0.32}, {x1, kTop - 0.035, 0.31}, 0.045, kOak, 1, 842);
    for (int k = 0; k < 3; ++k) {
      const double y = 0.09 + 0.21 * k;
      put_wood(place,
               kDesk(place.rectangle({x0 + 0.025, y, 0.322}, kRight, kUp, 0.31, 0.18, 0.04, 0.1)),
               kOak * 1.25, 0, 843);
      place.put(kDesk(slab(place, {x0 + 0.025, y - 0.012, 0.318}, kRight, kUp, 0.31, 0.012, 0.06)),
                kWalnut * 0.4);
      place.put(
          kDesk(with_thickness(
              place.ball({(x0 + x1) / 2, y + 0.09, 0.335}, {0.016, 0.016, 0.016}, 0.012), 0.4)),
          kBrass);
    }
  }
}

// A reading lamp with a shade of green glass.
void lamp(Place& place) {
  const Vec3 foot{-0.42, kTop, -0.14};
  const auto brass = [](Dot& d) {
    d.albedo = kBrass;
    d.gloss = 0.8;
  };
  place.put(
      kDesk(with_thickness(
          turned(place, foot,
                 {{0.09, 0}, {0.08, 0.02}, {0.025, 0.03}, {0.014, 0.06}, {0.012, 0.36}}, 0.022),
          0.35)),
      brass);
  place.put(
      kDesk(with_thickness(
          place.tube(foot + kUp * 0.36, foot + Vec3{0, 0.39, 0.11}, 0.011, 0.011, 0.03), 0.5)),
      brass);
  const Vec3 middle = foot + Vec3{0, 0.37, 0.11};
  const Patch glass =
      place.tube(middle - kRight * 0.17, middle + kRight * 0.17, 0.085, 0.085, 0.021);
  place.put(kDesk(kept(glass, [&](const Dot& d) { return d.p[1] > middle[1] - 0.012; })),
            [&](Dot& d) {
              d.emit = mix(Vec3{0.10, 0.60, 0.22}, Vec3{0.02, 0.20, 0.07},
                           smooth(0.0, 0.09, d.p[1] - middle[1]));
              d.albedo = {0.02, 0.10, 0.04};
              d.gloss = 0.5;
              d.opacity = 0.985;
            });
  place.put(
      kDesk(with_thickness(
          place.tube(middle - kRight * 0.12, middle + kRight * 0.12, 0.018, 0.018, 0.03), 0.5)),
      [](Dot& d) {
        d.emit = {3.0, 2.3, 1.4};
        d.kind = Kind::kUnshaded;
      });
  place.put({kDesk.moved(glow(middle - kUp * 0.03, 0.16, 0.10, kWarm * 1.6))}, [](Dot&) {});
  if (place.counting) return;
  place.light.lamps.push_back({kDesk(middle - kUp * 0.02), 0.45, {0, -1, 0}, true, kWarm, 0.07});
}

void globe(Place& place) {
  const Vec3 foot{0.52, kTop, -0.10}, center = foot + kUp * 0.24;
  const auto brass = [](Dot& d) {
    d.albedo = kBrass;
    d.gloss = 0.6;
  };
  place.put(
      kDesk(with_thickness(
          turned(place, foot, {{0.085, 0}, {0.07, 0.02}, {0.018, 0.035}, {0.015, 0.10}}, 0.022),
          0.35)),
      brass);
  place.put(
      kDesk(with_thickness(place.ball(center, {0.145, 0.145, 0.145}, 0.0185), 0.15)), [&](Dot& d) {
        const double land = 0.6 * place.noise(d.p, 0.10, 845) + 0.4 * place.noise(d.p, 0.035, 846);
        d.albedo = land > 0.53 ? mix(Vec3{0.42, 0.34, 0.14}, Vec3{0.16, 0.24, 0.08},
                                     smooth(0.53, 0.62, land))
                               : Vec3{0.06, 0.17, 0.28};
        if (std::abs(d.b) > 0.88) d.albedo = {0.6, 0.6, 0.55};
        d.gloss = 0.5;
      });
  for (int k = 0; k < 14; ++k) {  // the half ring that holds it
    const double t0 = 0.25 + 0.5 * k / 14, t1 = 0.25 + 0.5 * (k + 1) / 14;
    const auto at = [&](double t) {
      return center + Vec3{0.165 * cos_turns(t), 0.165 * sin_turns(t), 0};
    };
    place.put(kDesk(with_thickness(place.tube(at(t0), at(t1), 0.007, 0.007, 0.03), 0.6)), brass);
  }
  if (!place.counting) place.light.ball(kDesk(center), 0.14, 0, {0.1, 0.18, 0.2});
}

// An open book, loose sheets, a mug with pencils.
void papers(Place& place) {
  const auto lines = [](Dot& d, double high) {
    const double row = d.b / 0.022;
    const bool ink = d.a > 0.02 && d.b > 0.02 && d.b < high - 0.02 && row - std::floor(row) < 0.4;
    d.albedo = ink ? Vec3{0.30, 0.27, 0.23} : Vec3{0.64, 0.59, 0.47};
  };
  for (const double s : {-1.0, 1.0}) {
    const Vec3 slope = unit({1, -0.12 * s, 0});
    const Vec3 corner{s < 0 ? -0.17 : 0.0, kTop + (s < 0 ? 0.010 : 0.03), 0.22};
    place.put(kDesk(place.rectangle(corner, slope, kFront * -1, 0.17, 0.24, 0.021, 0.1)),
              [&](Dot& d) { lines(d, 0.24); });
  }
  place.put(kDesk(crate(place, {-0.18, kTop + 0.004, -0.03}, {0.18, kTop + 0.012, 0.23}, 0.03)),
            Vec3{0.22, 0.05, 0.04});
  for (int k = 0; k < 2; ++k) {
    const Stand sheet(kDesk({0.30 + 0.02 * k, kTop + 0.006 + 0.004 * k, 0.16}),
                      -0.25 + 0.03 - 0.05 * k);
    place.put(
        sheet(place.rectangle({-0.075, 0, 0.105}, kRight, kFront * -1, 0.15, 0.21, 0.024, 0.1)),
        [&](Dot& d) { lines(d, 0.21); });
  }
  const Vec3 mug{-0.62, kTop, 0.12};
  place.put(kDesk(with_thickness(place.tube(mug, mug + kUp * 0.10, 0.042, 0.042, 0.018), 0.25)),
            [](Dot& d) {
              d.albedo = d.b > 0.35 && d.b < 0.6 ? Vec3{0.60, 0.56, 0.48} : Vec3{0.10, 0.18, 0.26};
              d.gloss = 0.4;
            });
  place.put(kDesk(place.disc(mug + kUp * 0.085, 0, 0.038, 0.018)), Vec3{0.02, 0.02, 0.02});
  constexpr Vec3 kPencils[] = {
      {0.65, 0.45, 0.06}, {0.55, 0.07, 0.05}, {0.08, 0.25, 0.45}, {0.10, 0.35, 0.14}};
  for (int k = 0; k < 4; ++k) {
    const Vec3 lean = on_circle(k / 4.0 + 0.1, 0.03);
    place.put(
        kDesk(with_thickness(place.tube(mug + kUp * 0.06, mug + lean + kUp * (0.18 + 0.012 * k),
                                        0.0055, 0.0055, 0.03),
                             0.6)),
        kPencils[k]);
  }
}

// A round stool of wood that turns on its screw.
void stool(Place& place) {
  const Vec3 foot{0.05, 0, 0.72};
  const auto limb = [&](const Vec3& a, const Vec3& b, double r) {
    put_wood(place, kDesk(with_thickness(place.tube(foot + a, foot + b, r * 1.1, r, 0.04), 0.5)),
             kWalnut * 1.4, 1, 851);
  };
  put_wood(place, kDesk(place.disc(foot + kUp * 0.47, 0, 0.185, 0.03)), kOak * 1.1, 0, 852, 0.5);
  put_wood(place, kDesk(place.tube(foot + kUp * 0.43, foot + kUp * 0.47, 0.18, 0.185, 0.03)), kOak,
           0, 852, 0.3);
  for (int k = 0; k < 4; ++k)
    limb(on_circle(k / 4.0 + 0.12, 0.20), on_circle(k / 4.0 + 0.12, 0.09) + kUp * 0.43, 0.018);
  for (int k = 0; k < 4; ++k)
    limb(on_circle(k / 4.0 + 0.12, 0.155) + kUp * 0.18,
         on_circle((k + 1) / 4.0 + 0.12, 0.155) + kUp * 0.18, 0.010);
  if (!place.counting) place.light.drum(kDesk(foot), 0.18, 0.43, 0.47, kOak);
}

}  // namespace

void make_desk(Place& place) {
  table(place);
  lamp(place);
  globe(place);
  papers(place);
  stool(place);
}

}  // namespace l4d::io::synth
