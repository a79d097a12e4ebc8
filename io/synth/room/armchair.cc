// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

constexpr Vec3 kLeather{0.215, 0.062, 0.036};

// A wing chair that looks along z.
void chair(Place& place, const Stand& stand) {
  const auto leather = [&](const Patch& patch, double shade = 1) {
    place.put(stand(patch), [&](Dot& d) {
      d.albedo = kLeather * (shade * (0.70 + 0.6 * place.noise(d.p, 0.11, 821)));
      d.gloss = 0.45;
    });
  };
  const auto cell = 0.042;
  leather(crate(place, {-0.34, 0.14, -0.34}, {0.34, 0.40, 0.36}, cell), 0.85);
  leather(with_thickness(place.ball({0, 0.43, 0.06}, {0.325, 0.095, 0.33}, 0.036), 0.15), 1.15);
  leather(crate(place, {-0.36, 0.36, -0.46}, {0.36, 1.04, -0.30}, cell));
  leather(with_thickness(place.ball({0, 0.74, -0.28}, {0.30, 0.29, 0.085}, 0.036), 0.15), 1.1);
  leather(place.tube({-0.37, 1.04, -0.38}, {0.37, 1.04, -0.38}, 0.085, 0.085, cell));
  for (const double s : {-1.0, 1.0}) {
    leather(with_thickness(place.ball({0.37 * s, 1.04, -0.38}, {0.03, 0.083, 0.083}, 0.03), 0.2));
    leather(
        crate(place, {s < 0 ? -0.47 : 0.33, 0.14, -0.40}, {s < 0 ? -0.33 : 0.47, 0.58, 0.36}, cell),
        0.9);
    leather(place.tube({0.41 * s, 0.59, -0.34}, {0.41 * s, 0.59, 0.37}, 0.088, 0.088, cell));
    leather(with_thickness(place.ball({0.41 * s, 0.59, 0.37}, {0.085, 0.085, 0.022}, 0.026), 0.2),
            1.1);
    leather(crate(place, {s < 0 ? -0.41 : 0.33, 0.58, -0.42}, {s < 0 ? -0.33 : 0.41, 1.02, -0.14},
                  cell));
    leather(with_thickness(
        place.tube({0.37 * s, 0.62, -0.13}, {0.37 * s, 1.0, -0.16}, 0.042, 0.042, 0.04), 0.3));
    for (const double z : {-0.38, 0.30}) {
      put_wood(place,
               stand(with_thickness(
                   place.tube({0.38 * s, 0.0, z}, {0.36 * s, 0.15, z}, 0.018, 0.03, 0.035), 0.5)),
               kWalnut, 1, 822);
    }
    solid(place, stand, {s < 0 ? -0.47 : 0.33, 0.14, -0.40}, {s < 0 ? -0.33 : 0.47, 0.63, 0.36},
          kLeather);
    solid(place, stand, {s < 0 ? -0.41 : 0.33, 0.6, -0.42}, {s < 0 ? -0.33 : 0.41, 1.02, -0.14},
          kLeather);
  }
  solid(place, stand, {-0.34, 0.14, -0.34}, {0.34, 0.45, 0.36}, kLeather);
  solid(place, stand, {-0.36, 0.36, -0.46}, {0.36, 1.10, -0.30}, kLeather);
  for (int row = 0; row < 3; ++row) {  // buttons
    for (int k = 0; k < 3 + row % 2; ++k) {
      const double x = 0.15 * (k - (2 + row % 2) / 2.0), y = 0.62 + 0.13 * row;
      const double bulge = 1 - x * x / 0.09 - (y - 0.74) * (y - 0.74) / 0.0841;
      const Vec3 p{x, y, -0.28 + 0.085 * std::sqrt(std::max(bulge, 0.0)) + 0.002};
      place.put(stand(with_thickness(place.ball(p, {0.013, 0.013, 0.008}, 0.012), 0.4)),
                kLeather * 0.4);
    }
  }
  // A cushion leans in its corner.
  const Stand leaning(stand({0.12, 0.63, -0.13}), 0);
  const Patch cushion = place.ball({0, 0, 0}, {0.19, 0.17, 0.075}, 0.03);
  place.put(stand(with_thickness(cushion, 0.2)), [&](Dot& d) {
    d.p = d.p - stand({0, 0, 0}) + leaning({0, 0, 0});
    const bool stripe = std::abs(d.b) < 0.18 || std::abs(std::abs(d.b) - 0.62) < 0.09;
    d.albedo = (stripe ? Vec3{0.60, 0.50, 0.32} : Vec3{0.50, 0.27, 0.05}) *
               (0.85 + 0.3 * place.random_at(823, d.p));
  });
}

// A lampshade glows as cloth before a bulb does: most around its middle.
void shade(Place& place, const Vec3& low, const Vec3& high, double r0, double r1) {
  const Patch cloth = place.tube(low, high, r0, r1, 0.034);
  place.put(cloth, [](Dot& d) {
    d.emit = Vec3{1.0, 0.60, 0.27} * (0.75 + 0.75 * (1 - std::abs(2 * d.b - 0.9)));
    d.kind = Kind::kUnshaded;
    d.opacity = 0.985;
  });
  Patch inside = place.tube(low + kUp * 0.01, high - kUp * 0.01, r0 - 0.012, r1 - 0.012, 0.05);
  turn_over(inside);
  place.put(inside, [](Dot& d) {
    d.emit = {1.5, 1.05, 0.6};
    d.kind = Kind::kUnshaded;
  });
  for (const auto& [p, r] : {std::pair{low, r0}, std::pair{high, r1}}) {
    place.put(with_thickness(
                  place.tube(p - kUp * 0.008, p + kUp * 0.008, r + 0.003, r + 0.003, 0.04), 0.4),
              [](Dot& d) {
                d.emit = {0.42, 0.22, 0.07};
                d.kind = Kind::kUnshaded;
              });
  }
  const Vec3 bulb = (low + high) * 0.5;
  place.put({glow(bulb, 0.045, 0.8, {3, 2.4, 1.6}),
             glow(bulb + kUp * 1e-3, 0.34, 0.05, {1.3, 0.75, 0.32})},
            [](Dot&) {});
}

}  // namespace

void make_shade(Place& place, const Vec3& low, const Vec3& high, double r0, double r1) {
  shade(place, low, high, r0, r1);
}

void make_armchair(Place& place) {
  chair(place, Stand({1.78, 0, -0.95}, -0.165));
  // The lamp behind it.
  const Vec3 foot{2.62, 0, -1.85};
  place.put(
      with_thickness(place.tube(foot + kUp * 0.03, foot + kUp * 1.5, 0.014, 0.014, 0.05), 0.5),
      kBrass * 0.7);
  place.put(place.disc(foot + kUp * 0.035, 0, 0.15, 0.035, -0.015), [](Dot& d) {
    d.albedo = kBrass * 0.7;
    d.gloss = 0.6;
  });
  shade(place, foot + kUp * 1.42, foot + kUp * 1.74, 0.25, 0.15);
  if (place.counting) return;
  place.light.lamps.push_back({foot + kUp * 1.5, 0.80, {}, true, kWarm, 0.12});
  place.light.lamps.push_back({foot + kUp * 1.78, 0.30, kUp, false, kWarm});
}

}  // namespace l4d::io::synth
