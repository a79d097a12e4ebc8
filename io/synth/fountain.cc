// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

constexpr Vec3 kFountainFoot{-3.7, 0, -1.2};
constexpr double kGravity = 9.81, kPiece = 0.11;

void basins(Place& place) {
  const auto stone = [&](const Patch& patch, uint64_t key, double shade = 1) {
    place.put(patch, [&](Dot& d) {
      d.albedo = Vec3{0.36, 0.34, 0.33} * (shade * (0.65 + 0.7 * place.noise(d.p, 0.3, key)));
    });
  };
  const auto tube = [&](double y0, double y1, double r0, double r1, double cell) {
    return place.tube(kFountainFoot + kUp * y0, kFountainFoot + kUp * y1, r0, r1, cell);
  };
  stone(tube(0, 0.5, 1.75, 1.65, 0.11), 81);
  stone(place.disc(kFountainFoot + kUp * 0.53, 1.42, 1.80, 0.10), 82);
  stone(tube(0.46, 0.54, 1.8, 1.8, 0.1), 82);
  stone(tube(0.3, 1.3, 0.24, 0.16, 0.09), 83);
  stone(tube(1.22, 1.5, 0.2, 0.78, 0.08), 84);
  stone(place.disc(kFountainFoot + kUp * 1.5, 0.68, 0.8, 0.07), 84);
  stone(tube(1.4, 1.85, 0.1, 0.06, 0.07), 85);
  Patch inside = tube(0.36, 0.52, 1.44, 1.44, 0.12);
  turn_over(inside);
  stone(inside, 86, 0.7);
  for (const auto& [y, r] : {std::pair{0.40, 1.43}, std::pair{1.46, 0.7}}) {
    place.put(place.disc(kFountainFoot + kUp * y, 0, r, 0.13), [](Dot& d) {
      d.albedo = {0.03, 0.06, 0.075};
      d.emit = {0.02, 0.035, 0.05};
      d.gloss = 1;
    });
  }
  if (place.counting) return;
  place.light.drum(kFountainFoot, 1.75, 0, 0.5, {0.2, 0.18, 0.17});
  place.light.drum(kFountainFoot, 0.75, 1.3, 1.5, {0.2, 0.18, 0.17});
}

// One drop on its parabola, as straight pieces.
void drop(Place& place, int64_t i, double birth) {
  const auto hash = [&](int64_t k) { return place.random(86, i, k); };
  const bool jet = hash(1) < 0.42;
  const double turns = jet ? hash(2) : std::floor(hash(2) * 8) / 8 + 0.003 * (hash(3) - 0.5);
  const double out = jet ? 0.55 + 0.30 * (hash(4) - 0.5) : 0.75 + 0.12 * (hash(4) - 0.5);
  const double rise = jet ? 3.3 + 0.4 * (hash(5) - 0.5) : 0.9 + 0.2 * (hash(5) - 0.5);
  const Vec3 start = kFountainFoot + (jet ? kUp * 1.85 : kUp * 1.5 + on_circle(turns, 0.76));
  const Vec3 v0 = on_circle(turns, out) + kUp * rise;
  const double floor = jet && out < 0.55 ? 1.48 : 0.42;
  const double life =
      (rise + std::sqrt(rise * rise + 2 * kGravity * (start[1] - floor))) / kGravity;
  const double warm = hash(6);
  const Vec3 color = mix(Vec3{0.30, 0.38, 0.52}, Vec3{0.95, 0.66, 0.40}, 0.8 * warm * warm);
  for (int64_t k = 0; (static_cast<double>(k) + 0.5) * kPiece < life - 0.02; ++k) {
    const double age = (static_cast<double>(k) + 0.5) * kPiece, at = birth + age;
    if (at < -0.2 || at > place.action + 0.2) continue;
    const Vec3 velocity = v0 - kUp * (kGravity * age);
    Dot d;
    d.p = start + v0 * age - kUp * (0.5 * kGravity * age * age);
    d.u = unit(velocity);
    d.v = unit(cross(d.u, {0.3, 0.1, 0.9}));
    d.n = cross(d.u, d.v);
    d.su = 0.045 * std::min(1.5, std::sqrt(std::max(1.0, place.density)));
    d.sv = 0.013 * (1 + 0.4 * age) * std::min(2.0, std::max(1.0, place.density));
    d.emit = color * (0.55 + 0.9 * place.random(87, i, k));
    d.kind = Kind::kUnshaded;
    d.opacity = 0.62;
    d.thin = 1;
    d.velocity = velocity * (1 / place.stretch);
    place.flash(d, at, 0.6 * kPiece * place.stretch);
  }
}

}  // namespace

void make_fountain(Place& place) {
  place.still([&] { basins(place); });
  if (!place.drops) return;
  const double span = place.action + 1.2;
  const int64_t drops = std::max<int64_t>(8, place.detailed(620 * span));
  for (int64_t i = 0; i < drops; ++i) {
    const double share =
        (static_cast<double>(i) + place.random(86, i, 0)) / static_cast<double>(drops);
    drop(place, i, -1.1 + span * share);
  }
  const int64_t rings = std::max<int64_t>(4, place.detailed(60 * place.action));
  for (int64_t i = 0; i < rings; ++i) {  // on the water, where drops fall
    const auto hash = [&](int64_t k) { return place.random(89, i, k); };
    Dot d;
    d.p = kFountainFoot + kUp * 0.425 +
          on_circle(hash(0), hash(1) < 0.5 ? 1.22 + 0.1 * hash(2) : 0.5 + 0.7 * hash(2));
    d.v = {0, 0, -1};
    d.n = kUp;
    d.su = d.sv = 0.07;
    d.emit = {0.35, 0.42, 0.5};
    d.kind = Kind::kUnshaded;
    d.opacity = 0.5;
    d.thin = 0.05;
    place.flash(d, place.action * hash(3), 0.06 * place.stretch);
  }
}

}  // namespace l4d::io::synth
