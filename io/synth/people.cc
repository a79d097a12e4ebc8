// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

constexpr Vec3 kSkin{0.60, 0.36, 0.25};

void juggler_body(Place& place, const Vec3& at) {
  constexpr Vec3 kRedCloth{0.55, 0.07, 0.06}, kCreamCloth{0.75, 0.68, 0.55},
      kDark{0.07, 0.07, 0.11};
  const auto limb = [&](const Vec3& a, const Vec3& b, double r0, double r1, const Vec3& color,
                        bool stripes = false) {
    place.put(place.tube(at + a, at + b, r0, r1, 0.052), [&](Dot& d) {
      d.albedo = stripes && static_cast<int>(d.p[1] / 0.09) % 2 == 0 ? kCreamCloth : color;
      d.thin = r1 < 0.12 && r0 < 0.12 ? 0.45 : 0.1;
    });
  };
  const auto bulb = [&](const Vec3& center, const Vec3& radii, double cell, const Vec3& color) {
    place.put(place.ball(at + center, radii, cell), [&](Dot& d) {
      d.albedo = color;
      d.thin = 0.3;
    });
  };
  limb({-0.12, 0.06, 0}, {-0.10, 0.85, 0}, 0.07, 0.10, kDark);
  limb({0.14, 0.06, 0.05}, {0.10, 0.85, 0}, 0.07, 0.10, kDark);
  limb({0, 0.80, 0}, {0, 1.42, 0}, 0.17, 0.20, kRedCloth, true);
  for (const double s : {-1.0, 1.0}) {
    limb({0.22 * s, 1.40, 0}, {0.33 * s, 1.10, 0.05}, 0.065, 0.05, kCreamCloth);
    limb({0.33 * s, 1.10, 0.05}, {0.30 * s, 1.12, 0.36}, 0.05, 0.04, kCreamCloth);
    bulb({0.30 * s, 1.12, 0.4}, {0.055, 0.055, 0.055}, 0.045, kSkin);
    bulb({0.042 * s, 1.685, 0.108}, {0.017, 0.017, 0.017}, 0.018, {0.03, 0.02, 0.02});
  }
  limb({0, 1.40, 0}, {0, 1.56, 0}, 0.06, 0.06, kSkin);
  limb({0, 1.76, 0}, {0, 1.98, -0.02}, 0.13, 0.09, kDark);
  limb({0, 1.765, 0}, {0, 1.78, 0}, 0.20, 0.19, kDark);
  bulb({0, 1.66, 0}, {0.11, 0.14, 0.12}, 0.045, kSkin);
  bulb({-0.12, 0.05, 0.06}, {0.07, 0.06, 0.14}, 0.045, kDark);
  bulb({0.14, 0.05, 0.11}, {0.07, 0.06, 0.14}, 0.045, kDark);
  bulb({0, 1.41, 0}, {0.25, 0.08, 0.14}, 0.045, kRedCloth);
  if (place.counting) return;
  place.light.ball(at + kUp * 1.15, 0.27, 0, {0.1, 0.12, 0.05});
  place.light.ball(at + kUp * 0.45, 0.22, 0, {0.1, 0.12, 0.05});
}

// A flight of 1 s from hand to hand, then 0.3 s in a low scoop in the hand.
Vec3 juggled(double t, int k) {
  constexpr double kFly = 1.0, kHold = 0.3, kFall = 9.81;
  const double throws = t / (kFly + kHold) + k * 2 / 3.0, whole = std::floor(throws);
  const double x = (throws - whole) * (kFly + kHold);
  const double side = whole - 2 * std::floor(whole / 2) < 0.5 ? 1 : -1;
  if (x < kFly)
    return {side * mix(-0.24, 0.36, x / kFly), 1.24 + 0.5 * kFall * x * (kFly - x), 0.42};
  const double in_hand = (x - kFly) / kHold;
  return {side * mix(0.36, 0.24, smooth(0, 1, in_hand)),
          1.24 - 0.5 * kFall * kFly * (x - kFly) * (1 - in_hand), 0.42};
}

struct Walk {
  Vec3 start, coat;
  double size;
  bool balloon;
};

// A figure at the origin that looks along z; limbs turn about joints.
struct Limb {
  Patch patch;
  Vec3 color;
  double joint = 0, swing = 0, phase = 0;  // height, radians, turns
};

std::vector<Limb> figure(const Place& place, const Walk& walk) {
  constexpr Vec3 kDark{0.06, 0.06, 0.09};
  std::vector<Limb> out;
  for (const double s : {-1.0, 1.0}) {
    const double leg = 0.25 * (s + 1), arm = 0.25 * (1 - s);
    out.push_back({place.tube({0.09 * s, 0.88, 0}, {0.09 * s, 0.06, 0}, 0.095, 0.06, 0.12), kDark,
                   0.88, 0.50, leg});
    out.push_back({place.ball({0.09 * s, 0.05, 0.05}, {0.06, 0.055, 0.12}, 0.075), kDark * 0.6,
                   0.88, 0.50, leg});
    out.push_back({place.tube({0.23 * s, 1.38, 0}, {0.25 * s, 0.86, 0.04}, 0.065, 0.045, 0.1),
                   walk.coat, 1.38, 0.42, arm});
    out.push_back(
        {place.ball({0.25 * s, 0.82, 0.04}, {0.05, 0.05, 0.05}, 0.055), kSkin, 1.38, 0.42, arm});
  }
  out.push_back({place.tube({0, 0.70, 0}, {0, 1.42, 0}, 0.235, 0.17, 0.1), walk.coat});
  out.push_back({place.ball({0, 1.40, 0}, {0.22, 0.09, 0.13}, 0.09), walk.coat});
  out.push_back({place.ball({0, 1.62, 0}, {0.10, 0.135, 0.11}, 0.06), kSkin});
  out.push_back({place.ball({0, 1.68, -0.025}, {0.115, 0.11, 0.115}, 0.06), {0.16, 0.09, 0.05}});
  out.push_back({place.tube({0, 1.36, 0}, {0, 1.50, 0}, 0.10, 0.07, 0.06), {0.60, 0.08, 0.07}});
  if (walk.balloon) {
    out.push_back({place.ball({-0.25, 2.75, 0}, {0.20, 0.25, 0.20}, 0.11), {0.75, 0.08, 0.07}});
    out.push_back(
        {place.tube({-0.25, 1.0, 0.1}, {-0.25, 2.5, 0}, 0.008, 0.008, 0.2), {0.4, 0.4, 0.4}});
  }
  return out;
}

// Walkers go round in a long loop, at 1 m a second: nobody turns on the spot.
struct Step {
  Vec3 at;
  double heading;  // turns
};
Step along_loop(const Vec3& start, double t) {
  constexpr double kStraight = 8, kRadius = 1.6;
  const double bend = kTurn / 2 * kRadius, round = 2 * (kStraight + bend);
  double s = t - std::floor(t / round) * round;
  const Vec3 back{0, 0, 2 * kRadius};
  if (s < kStraight) return {start + Vec3{s, 0, 0}, 0.25};
  s -= kStraight;
  if (s < bend) {
    const double turns = s / bend / 2;
    return {start + Vec3{kStraight, 0, kRadius} +
                Vec3{sin_turns(turns), 0, 0.0 - cos_turns(turns)} * kRadius,
            0.25 - turns};
  }
  s -= bend;
  if (s < kStraight) return {start + back + Vec3{kStraight - s, 0, 0}, -0.25};
  s -= kStraight;
  const double turns = s / bend / 2;
  return {start + Vec3{0, 0, kRadius} + Vec3{0.0 - sin_turns(turns), 0, cos_turns(turns)} * kRadius,
          -0.25 - turns};
}

Dot walking(Dot d, const Limb& limb, const Walk& walk, double t) {
  const double rate = 0.85 / walk.size;
  const double turns = limb.swing / kTurn * sin_turns(rate * t + limb.phase);
  const double c = cos_turns(turns), s = sin_turns(turns);
  const auto tilt = [&](const Vec3& v) {
    return Vec3{v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]};
  };
  const Vec3 joint = kUp * limb.joint, bob = kUp * (0.02 * cos_turns(2 * rate * t));
  const Step step = along_loop(walk.start, t);
  d.p = turn_y((tilt(d.p - joint) + joint + bob) * walk.size, step.heading) + step.at;
  d.u = turn_y(tilt(d.u), step.heading);
  d.v = turn_y(tilt(d.v), step.heading);
  d.su *= walk.size;
  d.sv *= walk.size;
  return d;
}

// A soft shadow on the ground: black and faint.
Limb shadow_of(const Walk& walk) {
  Limb limb;
  for (int k = 0; k < 5; ++k) {
    Dot d;
    d.p = {0, 0.02 / walk.size, 0.12 * (k - 2)};
    d.v = {0, 0, -1};
    d.su = 0.17;
    d.sv = 0.13;
    limb.patch.push_back(d);
  }
  return limb;
}

}  // namespace

void make_juggler(Place& place) {
  const Vec3 at{-0.9, 0, 3.2};
  place.still([&] { juggler_body(place, at); });
  if (!place.rigid) return;
  constexpr Vec3 kColors[] = {{0.80, 0.10, 0.06}, {0.85, 0.60, 0.05}, {0.08, 0.35, 0.70}};
  for (int k = 0; k < 3; ++k) {
    const auto pose = [&](Dot d, double t) {
      d.p = d.p + at + juggled(t, k);
      return d;
    };
    place.chain(place.ball({0, 0, 0}, {0.095, 0.095, 0.095}, 0.05), 0.10, 0.6, pose, [&](Dot& d) {
      d.albedo = kColors[k];
      d.opacity = 0.985;
    });
  }
}

void make_walkers(Place& place) {
  if (!place.rigid) return;
  const Walk walks[] = {{{-4.2, 0, 5.3}, {0.12, 0.20, 0.30}, 1.0, false},
                        {{-4.4, 0, 5.9}, {0.62, 0.40, 0.08}, 0.68, true}};
  for (const Walk& walk : walks) {
    const Limb shadow = shadow_of(walk);
    place.chain(
        shadow.patch, 0.3, 0.6,
        [&](const Dot& d, double t) {
          Dot out = walking(d, shadow, walk, t);
          out.p[1] = 0.02;
          return out;
        },
        [](Dot& d) {
          d.kind = Kind::kUnshaded;
          d.opacity = 0.16;
          d.thin = 0.02;
        });
    for (const Limb& limb : figure(place, walk)) {
      const double piece = limb.swing > 0 ? 0.085 : 0.3;  // limbs turn fast
      place.chain(
          limb.patch, piece, 0.6, [&](const Dot& d, double t) { return walking(d, limb, walk, t); },
          [&](Dot& d) {
            d.albedo = limb.color;
            d.thin = 0.3;
            d.opacity = 0.985;
          });
    }
  }
}

}  // namespace l4d::io::synth
