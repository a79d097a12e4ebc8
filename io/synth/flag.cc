// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

constexpr Vec3 kPoleFoot{-0.6, 0, -5.0};
constexpr double kWide = 2.3, kHigh = 1.45;

// Where the point a metres from the pole and b above the lower edge is.
Vec3 cloth_at(double a, double b, double t) {
  const double swing = 0.05 + 0.16 * a / kWide;
  const double z = swing * sin_turns(0.62 * a - 1.05 * t + 0.16 * b) +
                   0.35 * swing * sin_turns(1.15 * a + 0.3 * b - 1.7 * t);
  const double droop = 0.05 * sin_turns(0.5 * a - 0.9 * t) * a / kWide - 0.10 * a * a / kWide;
  return kPoleFoot + Vec3{0.94 * a, 7.45 - kHigh + b + droop, z + 0.12 * a};
}

Dot waving(Dot d, double t) {
  constexpr double kStep = 1e-3;
  d.p = cloth_at(d.a, d.b, t);
  d.u = unit(cloth_at(d.a + kStep, d.b, t) - d.p);
  const Vec3 v = cloth_at(d.a, d.b + kStep, t) - d.p;
  d.v = unit(v - d.u * dot(d.u, v));
  d.n = cross(d.u, d.v);
  return d;
}

void dye(Dot& d) {
  const int third = static_cast<int>(d.b / kHigh * 3);
  d.albedo = third == 1 ? Vec3{0.85, 0.78, 0.60}
                        : (third == 2 ? Vec3{0.70, 0.08, 0.06} : Vec3{0.10, 0.20, 0.45});
  if (length(Vec3{d.a - kWide * 0.42, d.b - kHigh / 2, 0}) < 0.20) d.albedo = {0.85, 0.50, 0.08};
  d.opacity = 0.985;
}

// Puffs that rise, drift and grow, each in four stages.
void puffs(Place& place, const Vec3& at, uint64_t key) {
  const double span = place.action + 4;
  const int64_t n = std::max<int64_t>(
      4, static_cast<int64_t>(14 * span / std::max(1.0, place.density * place.density)));
  for (int64_t i = 0; i < n; ++i) {
    const auto hash = [&](int64_t k) { return place.random(key, i, k); };
    const double birth = -4 + span * (static_cast<double>(i) + hash(0)) / static_cast<double>(n);
    for (int k = 0; k < 4; ++k) {
      const double age = 0.4 + 0.9 * k;
      const Vec3 velocity{0.28 + 0.1 * hash(1), 0.75 - 0.1 * k + 0.2 * hash(2),
                          0.1 * hash(3) - 0.1};
      Dot d;
      d.p = at + velocity * age +
            Vec3{hash(4) - 0.5, hash(5) - 0.5, hash(6) - 0.5} * (0.15 * (1 + k));
      d.su = d.sv = 0.13 + 0.11 * k + 0.05 * hash(4);
      d.n = {0, 0, 1};
      d.emit = mix(Vec3{0.50, 0.32, 0.28}, Vec3{0.25, 0.25, 0.36}, k / 3.0);
      d.kind = Kind::kUnshaded;
      d.thin = 1;
      d.opacity = 0.16 - 0.035 * k;
      d.velocity = velocity * (1 / place.stretch);
      place.flash(d, birth + age, 0.45 * place.stretch);
    }
  }
}

}  // namespace

void make_flag(Place& place) {
  place.still([&] {
    place.put(place.tube(kPoleFoot, kPoleFoot + kUp * 7.6, 0.06, 0.035, 0.12),
              Vec3{0.55, 0.52, 0.48});
    place.put(place.ball(kPoleFoot + kUp * 7.68, {0.1, 0.1, 0.1}, 0.07), Vec3{0.75, 0.5, 0.1});
    place.put(place.box(kPoleFoot - Vec3{0.3, 0, 0.3}, kPoleFoot + Vec3{0.3, 0.3, 0.3}, 0.12),
              Vec3{0.3, 0.29, 0.28});
  });
  Patch cloth = place.rectangle({0, 0, 0}, {1, 0, 0}, kUp, kWide, kHigh, 0.085, 0.1);
  if (place.deform) {
    place.chain(cloth, 0.12, 0.6, waving, dye);
    return;
  }
  for (Dot& d : cloth) d = waving(d, 0);
  place.put(cloth, dye);
}

void make_smoke(Place& place, const std::vector<Vec3>& chimneys) {
  if (!place.deform) return;
  puffs(place, chimneys[1], 131);
  puffs(place, chimneys[3], 132);
}

}  // namespace l4d::io::synth
