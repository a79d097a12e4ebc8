// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

// A pot of clay with arching stems, leaves along each.
void potted(Place& place, const Vec3& foot, double size, int stems, double leaves, uint64_t key) {
  Patch pot = turned(place, foot,
                     {{0.13 * size, 0},
                      {0.18 * size, 0.28 * size},
                      {0.20 * size, 0.29 * size},
                      {0.20 * size, 0.34 * size}},
                     0.034);
  place.put(pot, [&](Dot& d) {
    d.albedo = Vec3{0.36, 0.155, 0.085} * (0.75 + 0.5 * place.noise(d.p, 0.1, key));
  });
  place.put(place.disc(foot + kUp * (0.31 * size), 0, 0.19 * size, 0.04), Vec3{0.045, 0.03, 0.02});
  if (!place.counting) place.light.drum(foot, 0.17 * size, 0, 0.33 * size, {0.3, 0.13, 0.07});
  if (!place.counting)
    place.light.ball(foot + kUp * (0.85 * size), 0.30 * size, 0.55, {0.05, 0.10, 0.03});
  const auto stem_at = [&](int64_t k, double s) {
    const double reach = size * (0.18 + 0.36 * place.random(key, k, 1)),
                 rise = size * (0.55 + 0.75 * place.random(key, k, 2));
    const Vec3 out = on_circle((static_cast<double>(k) + 0.6 * place.random(key, k, 3)) / stems,
                               reach * s * std::sqrt(s));
    return foot + kUp * (0.31 * size + rise * s - 0.30 * size * s * s * s) + out;
  };
  for (int k = 0; k < stems; ++k) {
    for (int j = 0; j < 4; ++j) {
      place.put(with_thickness(place.tube(stem_at(k, 0.25 * j), stem_at(k, 0.25 * (j + 1)),
                                          0.007 * size, 0.005 * size, 0.06),
                               0.7),
                Vec3{0.09, 0.12, 0.04});
    }
  }
  const int64_t n = place.detailed(leaves);
  const double grow = std::min(1.6, std::max(0.8, place.density));
  for (int64_t i = 0; i < n && place.is_static; ++i) {
    const auto hash = [&](int64_t j) { return place.random(key + 1, i, j); };
    const int64_t k = i % stems;
    const double s = 0.22 + 0.78 * std::sqrt(hash(0));
    const Vec3 spread{hash(1) - 0.5, hash(2) - 0.5, hash(3) - 0.5};
    const Vec3 p = stem_at(k, s) + spread * (0.15 * size);
    Dot d = place.leaf(p, unit(spread + kUp * 0.9), 0.034 * size * grow, key + 2, i);
    d.sv = d.su * 0.42;
    d.albedo = mix(Vec3{0.045, 0.12, 0.03}, Vec3{0.15, 0.27, 0.06}, hash(4)) * (0.6 + 0.7 * s);
    place.put({d}, [](Dot&) {});
  }
}

// Flowers of six petals on stems, in a glossy vase.
void bouquet(Place& place, const Vec3& foot) {
  place.put(
      with_thickness(
          turned(place, foot,
                 {{0.045, 0}, {0.085, 0.07}, {0.08, 0.14}, {0.035, 0.21}, {0.05, 0.26}}, 0.02),
          0.2),
      [&](Dot& d) {
        const bool band = std::abs(d.p[1] - foot[1] - 0.11) < 0.016;
        d.albedo = band ? Vec3{0.55, 0.38, 0.12} : Vec3{0.035, 0.13, 0.15};
        d.gloss = 1;
      });
  constexpr Vec3 kPetals[] = {
      {0.62, 0.08, 0.07}, {0.68, 0.46, 0.08}, {0.66, 0.60, 0.52}, {0.50, 0.13, 0.34}};
  for (int k = 0; k < 11; ++k) {
    const Vec3 lean = on_circle(k * 0.618034, 0.05 + 0.16 * place.random(861, k)) +
                      kUp * (0.48 + 0.16 * place.random(862, k));
    const Vec3 top = foot + lean, from = foot + kUp * 0.24;
    place.put(with_thickness(place.tube(from, top, 0.005, 0.005, 0.06), 0.7),
              Vec3{0.07, 0.14, 0.04});
    const Vec3 axis = unit(lean + kUp * 0.1 + kFront * -0.35);
    const Vec3 e1 = unit(cross(axis, {0.3, 0.1, 0.9})), e2 = cross(axis, e1);
    for (int j = 0; j < 8; ++j) {
      const Vec3 way = e1 * cos_turns(j / 8.0) + e2 * sin_turns(j / 8.0);
      Dot d;
      d.p = top + way * 0.026;
      d.u = unit(way + axis * 0.25);
      d.v = unit(cross(axis, d.u));
      d.n = cross(d.u, d.v);
      d.su = 0.017;
      d.sv = 0.011;
      d.kind = Kind::kLeaf;
      place.put({d}, kPetals[k % 4] * (0.8 + 0.3 * place.random(863, k, j)));
    }
    place.put(with_thickness(place.ball(top + axis * 0.006, {0.011, 0.011, 0.011}, 0.02), 0.5),
              Vec3{0.45, 0.28, 0.04});
    for (int j = 0; j < 2; ++j) {
      Dot leaf = place.leaf(mix(from, top, 0.45 + 0.25 * j), axis, 0.035, 864, 2 * k + j);
      leaf.albedo = Vec3{0.06, 0.15, 0.04} * (0.7 + 0.6 * place.random(865, k, j));
      place.put({leaf}, [](Dot&) {});
    }
  }
}

void sideboard(Place& place) {
  const Stand stand({-1.55, 0, kRoomHigh[2] - 0.24}, 0.5);
  constexpr double kTop = 0.86;
  plank(place, stand, {-0.90, 0.10, -0.21}, {0.90, kTop, 0.21}, 0.045, kOak * 0.95, 1, 871);
  plank(place, stand, {-0.93, kTop, -0.23}, {0.93, kTop + 0.03, 0.24}, 0.04, kOak * 1.05, 0, 872,
        0.6);
  for (int k = 0; k < 4; ++k) {
    const double x = -0.88 + 0.445 * k;
    put_wood(place,
             stand(place.rectangle({x + 0.02, 0.15, 0.222}, kRight, kUp, 0.385, 0.44, 0.042, 0.1)),
             kOak * 1.3, 1, 873);
    put_wood(place,
             stand(place.rectangle({x + 0.02, 0.64, 0.222}, kRight, kUp, 0.385, 0.17, 0.042, 0.1)),
             kOak * 1.3, 0, 874);
    place.put(stand(with_thickness(
                  place.ball({x + 0.21, 0.725, 0.235}, {0.016, 0.016, 0.016}, 0.012), 0.4)),
              kBrass);
    place.put(stand(with_thickness(place.ball({x + (k % 2 == 0 ? 0.37 : 0.05), 0.40, 0.235},
                                              {0.016, 0.016, 0.016}, 0.012),
                                   0.4)),
              kBrass);
    for (const double y : {0.12, 0.61}) {
      place.put(stand(slab(place, {x + 0.02, y, 0.216}, kRight, kUp, 0.385, 0.02, 0.08)),
                kWalnut * 0.45);
    }
  }
  for (const double x : {-0.85, 0.85}) {
    for (const double z : {-0.17, 0.17})
      put_wood(place,
               stand(with_thickness(place.tube({x, 0, z}, {x, 0.11, z}, 0.022, 0.03, 0.04), 0.5)),
               kWalnut, 1, 875);
  }
  bouquet(place, stand({0.35, kTop + 0.03, 0.0}));
  // A lamp, and a bowl of fruit.
  const Vec3 foot = stand({-0.55, kTop + 0.03, 0});
  place.put(
      with_thickness(
          turned(place, foot,
                 {{0.06, 0}, {0.095, 0.06}, {0.085, 0.14}, {0.03, 0.22}, {0.015, 0.26}}, 0.024),
          0.25),
      [](Dot& d) {
        d.albedo = {0.50, 0.45, 0.36};
        d.gloss = 0.8;
      });
  make_shade(place, foot + kUp * 0.26, foot + kUp * 0.46, 0.17, 0.10);
  if (!place.counting) place.light.lamps.push_back({foot + kUp * 0.33, 0.58, {}, true, kWarm, 0.1});
  const Vec3 bowl = stand({-0.12, kTop + 0.03, 0.02});
  Patch inside = turned(place, bowl, {{0.05, 0.014}, {0.13, 0.07}}, 0.024);
  turn_over(inside);
  append(inside, turned(place, bowl, {{0.055, 0}, {0.135, 0.07}}, 0.024));
  place.put(with_thickness(inside, 0.2), Vec3{0.40, 0.36, 0.30});
  constexpr Vec3 kFruit[] = {{0.55, 0.09, 0.05}, {0.60, 0.28, 0.03}, {0.30, 0.38, 0.06}};
  for (int k = 0; k < 6; ++k) {
    const Vec3 p = bowl + (k < 5 ? on_circle(k / 5.0, 0.068) + kUp * 0.075 : kUp * 0.12);
    place.put(with_thickness(place.ball(p, {0.043, 0.041, 0.043}, 0.02), 0.3), kFruit[k % 3]);
  }
}

}  // namespace

void make_plants(Place& place) {
  sideboard(place);
  potted(place, {-2.95, 0, 2.45}, 1.15, 17, 1500, 5100);
  potted(place, {kRoomLow[0] + 0.10, kWindow.y0, 0.72}, 0.30, 9, 320, 5200);
}

}  // namespace l4d::io::synth
