// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

const Stand kCat({0.62, 0.012, -0.36}, 0.06);

// Tabby fur: stripes across the back, white below.
Vec3 fur(const Place& place, const Dot& d) {
  const double wave = sin_turns(11 * d.p[2] + 0.5 * place.noise(d.p, 0.05, 951));
  const Vec3 ginger =
      mix(Vec3{0.46, 0.21, 0.065}, Vec3{0.22, 0.085, 0.028}, smooth(0.1, 0.7, wave));
  return ginger * (0.8 + 0.4 * place.random_at(952, d.p));
}

struct Part {
  Patch patch;
  double breath;  // how much of the breathing it takes part in
};

// A cat that lies with its paws before it and looks along z.
std::vector<Part> body(const Place& place) {
  std::vector<Part> out;
  const auto add = [&](Patch patch, double breath, const Vec3& color = {}) {
    for (Dot& d : patch) {
      d.albedo = color == Vec3{} ? fur(place, d) : color;
      d.thin = 0.35;
    }
    out.push_back({patch, breath});
  };
  constexpr double kCell = 0.029;
  const Vec3 white{0.58, 0.53, 0.45}, pink{0.46, 0.20, 0.16}, dark{0.03, 0.025, 0.015};
  add(place.ball({0, 0.105, -0.05}, {0.105, 0.105, 0.175}, kCell), 1);
  add(place.ball({0, 0.100, -0.16}, {0.115, 0.100, 0.10}, kCell), 0.6);
  add(place.ball({0, 0.115, 0.09}, {0.080, 0.095, 0.085}, kCell), 0.5);
  add(place.ball({0, 0.095, 0.135}, {0.055, 0.070, 0.055}, kCell), 0.4, white);
  add(place.ball({0, 0.215, 0.165}, {0.067, 0.060, 0.062}, 0.02), 0);
  add(place.ball({0, 0.197, 0.218}, {0.033, 0.025, 0.022}, 0.014), 0, white);
  add(place.ball({0, 0.207, 0.239}, {0.008, 0.006, 0.006}, 0.008), 0, pink);
  for (const double s : {-1.0, 1.0}) {
    add(place.tube({0.044 * s, 0.250, 0.155}, {0.054 * s, 0.315, 0.150}, 0.027, 0.003, 0.014), 0);
    add(place.ball({0.029 * s, 0.226, 0.217}, {0.010, 0.007, 0.008}, 0.008), 0, dark);
    add(place.tube({0.050 * s, 0.032, 0.10}, {0.042 * s, 0.028, 0.26}, 0.030, 0.025, 0.02), 0);
    add(place.ball({0.042 * s, 0.026, 0.268}, {0.029, 0.025, 0.034}, 0.018), 0, white);
    add(place.ball({0.105 * s, 0.045, -0.07}, {0.034, 0.045, 0.085}, kCell), 0.3);
  }
  return out;
}

Dot breathing(Dot d, double amount, double t) {
  const double in = amount * sin_turns(0.36 * t);
  d.p = d.p * Vec3{1 + 0.045 * in, 1 + 0.055 * in, 1 + 0.012 * in};
  if (amount == 0) d.p[1] += 0.0035 * sin_turns(0.36 * t - 0.08);  // head and paws
  return kCat.moved(d);
}

// The tail lies around its side; its end sweeps the rug.
Vec3 tail_at(double s, double t) {
  const double sweep = 0.10 * s * s * sin_turns(0.2 * t) + 0.015 * s * s * sin_turns(0.5 * t + 0.2);
  const double turns = 0.52 - 0.36 * s + sweep;
  const double r = 0.215 + 0.05 * s;
  return {0.02 + r * sin_turns(turns), 0.026 + 0.010 * sin_turns(0.6 * s),
          -0.05 + r * cos_turns(turns)};
}

Dot sweeping(Dot d, double t) {
  constexpr double kStep = 1e-3;
  const Vec3 middle = tail_at(d.b, t), axis = unit(tail_at(d.b + kStep, t) - middle);
  const Vec3 side = unit(cross(axis, kUp)), up = cross(side, axis);
  const double r = 0.026 - 0.009 * d.b;
  const Vec3 out = side * cos_turns(d.a) + up * sin_turns(d.a);
  d.p = middle + out * r;
  d.u = up * cos_turns(d.a) - side * sin_turns(d.a);
  d.v = cross(out, d.u);
  d.n = out;
  return kCat.moved(d);
}

}  // namespace

void make_cat(Place& place) {
  if (!place.counting) {
    place.light.ball(kCat({0, 0.10, -0.06}), 0.095, 0, {0.3, 0.15, 0.06});
    place.light.ball(kCat({0, 0.20, 0.165}), 0.055, 0, {0.3, 0.15, 0.06});
  }
  if (!place.deform && !place.is_static) return;
  const auto show = [&](Patch patch, double piece, const auto& pose, const auto& paint) {
    if (place.deform) {
      place.chain(patch, piece, 0.6, pose, paint);
      return;
    }
    for (Dot& d : patch) d = pose(d, 0);
    place.put(patch, paint);
  };
  const auto soft = [](Dot& d) { d.opacity = 0.985; };
  for (const Part& part : body(place)) {
    show(
        part.patch, 0.5, [&](const Dot& d, double t) { return breathing(d, part.breath, t); },
        soft);
  }
  Patch tail = place.tube({0, 0, 0}, {0, 0.42, 0}, 0.024, 0.024, 0.021);
  for (Dot& d : tail) {
    d.albedo = fur(place, d);
    const double ring = 7 * d.b - std::floor(7 * d.b);
    d.albedo = (ring < 0.4 ? Vec3{0.22, 0.085, 0.028} : Vec3{0.46, 0.21, 0.065}) *
               (0.85 + 0.3 * place.random_at(953, d.p));
    d.thin = 0.5;
  }
  show(tail, 0.24, sweeping, soft);
}

}  // namespace l4d::io::synth
