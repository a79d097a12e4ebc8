// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

const Stand kRocker({-1.42, 0, -1.02}, 0.175);
constexpr double kRunner = 1.2;  // radius of the runners, metres
constexpr double kPiece = 0.4;

struct Body {
  Patch dots;
  void put(Patch patch, const Vec3& color, double thin = 0.35, double gloss = 0) {
    for (Dot& d : patch) {
      d.albedo = color;
      d.thin = thin;
      d.gloss = gloss;
      dots.push_back(d);
    }
  }
};

// A chair of turned wood that looks along z.
void chair(const Place& place, Body& body) {
  const Vec3 color = kOak * 0.85;
  const auto rod = [&](const Vec3& a, const Vec3& b, double r) {
    body.put(place.tube(a, b, r, r * 0.95, 0.12), color, 0.5);
  };
  const auto runner = [](double s, double turns) {
    return Vec3{0.25 * s, kRunner * (1 - cos_turns(turns)) + 0.018, kRunner * sin_turns(turns)};
  };
  for (const double s : {-1.0, 1.0}) {
    for (int k = -3; k < 3; ++k)
      rod(runner(s, 0.024 * k - 0.004), runner(s, 0.024 * (k + 1) - 0.004), 0.019);
    rod(runner(s, 0.030), {0.23 * s, 0.43, 0.23}, 0.020);
    rod(runner(s, -0.034), {0.23 * s, 0.43, -0.21}, 0.020);
    rod({0.24 * s, 0.43, -0.22}, {0.26 * s, 1.16, -0.44}, 0.021);  // posts
    rod({0.29 * s, 0.66, -0.28}, {0.31 * s, 0.64, 0.22}, 0.022);   // arms
    rod({0.25 * s, 0.43, 0.18}, {0.30 * s, 0.64, 0.17}, 0.015);
    rod({0.25 * s, 0.43, -0.04}, {0.30 * s, 0.65, -0.05}, 0.012);
    body.put(place.ball({0.26 * s, 1.18, -0.445}, {0.028, 0.032, 0.028}, 0.03), color, 0.4);
  }
  rod({-0.24, 0.24, 0.24}, {0.24, 0.24, 0.24}, 0.014);
  rod({-0.24, 0.24, -0.22}, {0.24, 0.24, -0.22}, 0.014);
  body.put(crate(place, {-0.27, 0.415, -0.25}, {0.27, 0.45, 0.27}, 0.075), color, 0.08);
  for (int k = 0; k < 5; ++k)
    rod({0.08 * (k - 2), 0.45, -0.22}, {0.087 * (k - 2), 1.06, -0.415}, 0.010);
  const Vec3 up = unit({0, 0.73, -0.22});
  body.put(place.rectangle({-0.26, 1.02, -0.385}, kRight, up, 0.52, 0.13, 0.065, 0.1), color, 0.1);
  Patch back = place.rectangle({-0.26, 1.02, -0.41}, kRight, up, 0.52, 0.13, 0.065, 0.1);
  turn_over(back);
  body.put(back, color, 0.1);
}

// Someone who reads, in a cardigan, with a blanket over the knees.
void reader(const Place& place, Body& body) {
  const Vec3 skin{0.50, 0.29, 0.20}, wool{0.13, 0.25, 0.24}, hair{0.13, 0.085, 0.06},
      cloth{0.10, 0.095, 0.12};
  const auto limb = [&](const Vec3& a, const Vec3& b, double r0, double r1, const Vec3& color) {
    body.put(place.tube(a, b, r0, r1, 0.06), color, 0.25);
  };
  const auto bulb = [&](const Vec3& center, const Vec3& radii, double cell, const Vec3& color) {
    body.put(place.ball(center, radii, cell), color, 0.25);
  };
  limb({0, 0.46, -0.08}, {0, 0.74, -0.15}, 0.175, 0.165, wool);
  limb({0, 0.74, -0.15}, {0, 0.98, -0.20}, 0.165, 0.150, wool);
  bulb({0, 0.98, -0.20}, {0.205, 0.085, 0.125}, 0.055, wool);
  limb({0, 1.00, -0.19}, {0, 1.12, -0.17}, 0.056, 0.052, skin);
  // Skin below the hair would only shine through it.
  const auto scalp = [](const Dot& d) { return d.p[1] - 1.225 > 0.55 * (d.p[2] + 0.10); };
  body.put(kept(place.ball({0, 1.205, -0.14}, {0.088, 0.115, 0.10}, 0.028),
                [&](const Dot& d) { return !scalp(d); }),
           skin, 0.25);
  body.put(kept(place.ball({0, 1.215, -0.148}, {0.098, 0.122, 0.11}, 0.032), scalp), hair, 0.25);
  bulb({0, 1.30, -0.25}, {0.055, 0.055, 0.055}, 0.036, hair);
  bulb({0, 1.19, -0.038}, {0.016, 0.022, 0.020}, 0.016, skin * 1.05);
  for (const double s : {-1.0, 1.0}) {
    bulb({0.034 * s, 1.222, -0.047}, {0.008, 0.006, 0.006}, 0.012, {0.03, 0.02, 0.02});
    limb({0.195 * s, 0.96, -0.19}, {0.265 * s, 0.71, -0.06}, 0.060, 0.050, wool * 0.95);
    limb({0.265 * s, 0.71, -0.06}, {0.125 * s, 0.79, 0.19}, 0.050, 0.036, wool);
    bulb({0.265 * s, 0.71, -0.06}, {0.052, 0.052, 0.052}, 0.048, wool * 0.95);
    bulb({0.115 * s, 0.80, 0.22}, {0.035, 0.040, 0.042}, 0.034, skin);
    limb({0.10 * s, 0.52, -0.02}, {0.11 * s, 0.53, 0.36}, 0.098, 0.080, cloth);
    limb({0.11 * s, 0.53, 0.37}, {0.11 * s, 0.10, 0.40}, 0.068, 0.045, cloth);
    bulb({0.11 * s, 0.53, 0.37}, {0.078, 0.076, 0.07}, 0.052, cloth);
    bulb({0.11 * s, 0.075, 0.45}, {0.048, 0.045, 0.105}, 0.044, {0.30, 0.10, 0.07});
  }
  // The blanket: over the thighs, down before the knees; its checks are woven of two colours.
  const auto blanket = [&](Patch patch) {
    for (Dot& d : patch) {
      const double x = d.p[0] / 0.11, y = (d.p[1] - d.p[2]) / 0.11;
      const bool a = x - std::floor(x) < 0.4, b = y - std::floor(y) < 0.4;
      d.albedo = a && b ? Vec3{0.46, 0.36, 0.18}
                        : (a || b ? Vec3{0.34, 0.10, 0.06} : Vec3{0.22, 0.045, 0.04});
      d.thin = 0.15;
      body.dots.push_back(d);
    }
  };
  const Patch lap =
      place.rectangle({-0.25, 0.61, 0.42}, kRight, kFront * -1, 0.50, 0.42, 0.048, 0.1);
  Patch over = lap;
  for (Dot& d : over) {
    const double x = (d.a - 0.25) / 0.25;
    d.p[1] += 0.03 * cos_turns(1.7 * d.a - 0.425) - 0.10 * x * x * x * x;
  }
  blanket(over);
  Patch fall = place.rectangle({-0.25, 0.24, 0.455}, kRight, kUp, 0.50, 0.38, 0.048, 0.1);
  for (Dot& d : fall) d.p[2] += 0.016 * sin_turns(5 * d.a) * (1 - d.b / 0.38) + 0.012;
  blanket(fall);
  for (const double s : {-1.0, 1.0}) {
    const Vec3 out = s < 0 ? kFront : kFront * -1;
    Patch side =
        place.rectangle({0.255 * s, 0.42, s < 0 ? 0.02 : 0.44}, out, kUp, 0.42, 0.16, 0.05, 0.1);
    if (side.front().n[0] * s < 0) turn_over(side);
    blanket(side);
  }
  // The book: two covers and pages, held open.
  for (const double s : {-1.0, 1.0}) {
    const Vec3 leaf = unit({s, 0.10, 0.42}), up = unit({0, 0.80, -0.60 + 0.9}),
               rise = unit(up - leaf * dot(up, leaf));
    Patch pages = place.rectangle(Vec3{0, 0.78, 0.235}, leaf, rise, 0.13, 0.19, 0.035, 0.1);
    const Vec3 toward{0, 0.6, -0.8};
    if (dot(pages.front().n, toward) < 0) turn_over(pages);
    body.put(pages, {0.60, 0.55, 0.44}, 0.1);
    Patch cover = place.rectangle(Vec3{0, 0.775, 0.242} - toward * 0.008, leaf, rise, 0.138, 0.20,
                                  0.035, 0.1);
    if (dot(cover.front().n, toward) > 0) turn_over(cover);
    body.put(cover, {0.07, 0.10, 0.26}, 0.1);
  }
}

// The runners roll on the floor.
Dot rocking(Dot d, double t) {
  const double turns = -0.004 + 0.013 * sin_turns(0.25 * t);
  const double c = cos_turns(turns), s = sin_turns(turns);
  const auto tilted = [&](const Vec3& v) {
    return Vec3{v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]};
  };
  const Vec3 axis{0, kRunner, kRunner * kTurn * turns};
  d.p = tilted(d.p - Vec3{0, kRunner, 0}) + axis;
  d.u = tilted(d.u);
  d.v = tilted(d.v);
  d.n = tilted(d.n);
  return kRocker.moved(d);
}

}  // namespace

void make_rocker(Place& place) {
  if (!place.counting) {
    place.light.ball(kRocker({0, 0.74, -0.14}), 0.20, 0, {0.1, 0.2, 0.2});
    place.light.ball(kRocker({0, 1.2, -0.15}), 0.10, 0, {0.3, 0.2, 0.15});
    solid(place, kRocker, {-0.24, 0.41, -0.2}, {0.24, 0.56, 0.38}, {0.2, 0.06, 0.05});
  }
  if (!place.rigid && !place.is_static) return;
  Body body;
  chair(place, body);
  reader(place, body);
  const auto paint = [](Dot& d) { d.opacity = 0.985; };
  if (place.rigid) {
    place.chain(body.dots, kPiece, 0.58, rocking, paint);
  } else {
    for (Dot& d : body.dots) d = rocking(d, 0);
    place.put(body.dots, paint);
  }
}

}  // namespace l4d::io::synth
