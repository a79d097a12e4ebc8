// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

constexpr Vec3 kTable{-0.15, 0, 0.52};
constexpr double kTableTop = 0.46, kTableRadius = 0.52;
constexpr Vec3 kCup{0.09, kTableTop, 0.68};
constexpr Vec3 kBall{-0.27, kTableTop + 0.185, 0.46};

void wooden(Place& place) {
  put_wood(place, place.disc(kTable + kUp * kTableTop, 0, kTableRadius, 0.036), kOak * 1.2, 0, 801,
           0.7);
  put_wood(place,
           place.tube(kTable + kUp * (kTableTop - 0.045), kTable + kUp * kTableTop, kTableRadius,
                      kTableRadius, 0.036),
           kOak * 1.1, 0, 801, 0.3);
  put_wood(
      place,
      with_thickness(
          turned(place, kTable,
                 {{0.05, 0.1}, {0.075, 0.16}, {0.045, 0.2}, {0.06, 0.32}, {0.09, kTableTop - 0.05}},
                 0.035),
          0.3),
      kOak, 1, 802);
  for (int k = 0; k < 3; ++k) {
    const Vec3 out = on_circle((k + 0.4) / 3, 1);
    put_wood(place,
             with_thickness(place.tube(kTable + kUp * 0.15, kTable + out * 0.36 + kUp * 0.035,
                                       0.034, 0.026, 0.035),
                            0.4),
             kOak, 1, 803);
    put_wood(place,
             with_thickness(
                 place.ball(kTable + out * 0.37 + kUp * 0.03, {0.036, 0.03, 0.036}, 0.025), 0.4),
             kOak, 1, 804);
  }
  if (!place.counting)
    place.light.drum(kTable, kTableRadius, kTableTop - 0.045, kTableTop, kOak * 0.9);
}

void cup(Place& place) {
  const Vec3 china{0.66, 0.63, 0.58};
  const auto glaze = [&](Dot& d) {
    const bool rim = d.p[1] > kCup[1] + 0.062 && d.p[1] < kCup[1] + 0.072;
    d.albedo = rim ? Vec3{0.08, 0.14, 0.36} : china;
    d.gloss = 0.6;
  };
  place.put(place.disc(kCup + kUp * 0.006, 0, 0.085, 0.017, 0.012), glaze);
  Patch outer = turned(place, kCup, {{0.022, 0.01}, {0.042, 0.03}, {0.05, 0.08}}, 0.014);
  place.put(with_thickness(outer, 0.25), glaze);
  Patch inner = turned(place, kCup, {{0.038, 0.03}, {0.046, 0.08}}, 0.014);
  turn_over(inner);
  place.put(inner, glaze);
  place.put(place.disc(kCup + kUp * 0.066, 0, 0.044, 0.014), [](Dot& d) {
    d.albedo = {0.22, 0.08, 0.02};
    d.gloss = 0.9;
  });
}

void books(Place& place) {
  const Vec3 at = kTable + Vec3{0.10, kTableTop, -0.24};
  constexpr Vec3 kCovers[] = {{0.07, 0.14, 0.24}, {0.42, 0.28, 0.09}, {0.30, 0.055, 0.05}};
  for (int k = 0; k < 3; ++k) {
    const Stand stand(at + kUp * (0.036 * k), 0.04 - 0.06 * k + 0.02 * k * k);
    const Vec3 low{-0.13 + 0.012 * k, 0, -0.09}, high{0.13 - 0.012 * k, 0.034, 0.09};
    place.put(stand(place.box(low, high, 0.024)), [&](Dot& d) {
      const bool page = std::abs(d.n[1]) < 0.5 && d.p[1] > at[1] + 0.036 * k + 0.006 &&
                        d.p[1] < at[1] + 0.036 * k + 0.028 && dot(d.n, stand.way(kFront)) < 0.5;
      d.albedo = page ? Vec3{0.58, 0.52, 0.40} : kCovers[k];
      d.gloss = 0.25;
    });
    solid(place, stand, low, high, kCovers[k]);
  }
}

// Its stand is turned of brass. What it mirrors is what the scene's `view` is for.
void mirror_ball(Place& place) {
  const double r = 0.135;
  place.still([&] {
    place.put(with_thickness(
                  turned(place, kTable + Vec3{-0.12, kTableTop, -0.06},
                         {{0.085, 0}, {0.075, 0.015}, {0.03, 0.03}, {0.035, 0.055}, {0.07, 0.075}},
                         0.018),
                  0.3),
              [](Dot& d) {
                d.albedo = kBrass;
                d.gloss = 0.9;
              });
  });
  if (place.is_static || place.view) {
    place.put_always(place.ball(kBall, {r, r, r}, 0.0115), [](Dot& d) {
      d.albedo = {0.02, 0.02, 0.02};
      d.kind = Kind::kChrome;
      d.gloss = 1;
      d.thin = 0.1;
    });
  }
  if (!place.counting) place.light.ball(kBall, r - 0.006, 0, {0.2, 0.2, 0.2});
}

// Wisps that rise from the tea, widen and vanish.
void steam(Place& place) {
  const double span = place.action + 3;
  const int64_t n =
      std::max<int64_t>(4, static_cast<int64_t>(16 * span / std::max(1.0, place.density)));
  constexpr int kStages = 4;
  for (int64_t i = 0; i < n; ++i) {
    const auto hash = [&](int64_t k) { return place.random(811, i, k); };
    const double birth = -3 + span * (static_cast<double>(i) + hash(0)) / static_cast<double>(n);
    Vec3 p = kCup + Vec3{0.04 * (hash(1) - 0.5), 0.075, 0.04 * (hash(2) - 0.5)};
    for (int k = 0; k < kStages; ++k) {
      const double step = 0.55;
      const Vec3 velocity{0.07 * sin_turns(hash(3) + 0.3 * k), 0.15 + 0.04 * hash(4),
                          0.05 * sin_turns(hash(5) + 0.3 * k)};
      Dot d;
      d.p = p + velocity * (step / 2);
      p = p + velocity * step;
      d.u = unit(velocity);
      d.v = unit(cross(d.u, {0.3, 0.1, 0.9}));
      d.n = cross(d.u, d.v);
      d.su = 0.030 + 0.012 * k;
      d.sv = 0.009 + 0.008 * k;
      d.emit = {0.40, 0.36, 0.31};
      d.kind = Kind::kUnshaded;
      d.thin = 1;
      d.opacity = 0.075 - 0.016 * k;
      d.velocity = velocity * (1 / place.stretch);
      place.flash(d, birth + (k + 0.5) * step, 0.6 * step * place.stretch);
    }
  }
}

}  // namespace

void make_table(Place& place) {
  place.still([&] {
    wooden(place);
    cup(place);
    books(place);
  });
  mirror_ball(place);
  if (place.deform) steam(place);
}

}  // namespace l4d::io::synth
