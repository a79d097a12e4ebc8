// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/place.h"

// What lies beyond the square, as large far Gaussians that only emit: no view shows black.
namespace l4d::io::synth {
namespace {

Dot far_dot(const Vec3& direction, double distance, double su, double sv) {
  Dot d;
  d.p = direction * distance;
  d.u = unit(cross({1e-3, 1, 0}, direction));
  d.v = cross(direction * -1, d.u);
  d.n = direction * -1;
  d.su = su;
  d.sv = sv;
  d.kind = Kind::kUnshaded;
  return d;
}

void dome(Place& place) {
  constexpr double kRadius = 150, kSpan = 1.25;  // of the height of the unit ball
  const int64_t n = std::max<int64_t>(
      400, static_cast<int64_t>(8000 / std::max(0.5, place.density * place.density)));
  const double size = kRadius * std::sqrt(kTurn * kSpan / static_cast<double>(n));
  Patch patch;
  for (int64_t i = 0; i < n; ++i) {
    const double k = static_cast<double>(i) + 0.5, y = 1 - kSpan * k / static_cast<double>(n);
    const Vec3 around = on_circle(k * 0.6180339887498949, std::sqrt(1 - y * y));
    Dot d = far_dot({around[0], y, around[2]}, kRadius, size * 0.8, size * 0.8);
    d.opacity = 0.99;
    patch.push_back(d);
  }
  place.put(patch, [](Dot& d) { d.emit = sky(unit(d.p)); });
}

void clouds(Place& place) {
  Patch patch;
  const int64_t n = static_cast<int64_t>(1100 / std::max(1.0, place.density * place.density / 4));
  for (int64_t i = 0; i < n; ++i) {
    const auto hash = [&](int64_t k) { return place.random(90, i, k); };
    const int64_t group = static_cast<int64_t>(hash(0) * 34);
    const double az = place.random(91, group) + 0.055 * (hash(1) + hash(5) - 1);
    const double el = 0.07 + 0.32 * power(place.random(92, group), 1.3) +
                      0.022 * (hash(2) + hash(4) - 1) + 0.03 * sin_turns(9 * az);
    const Vec3 way = unit(on_circle(az, 1) + kUp * el);
    Dot d = far_dot(way, 140, 5 + 9 * hash(3) * hash(3), 1.6 + 2.2 * hash(4));
    const double near = clamp(dot(unit({way[0], 0, way[2]}), sunset()) * 0.5 + 0.5, 0, 1);
    d.emit = mix(Vec3{0.36, 0.22, 0.34}, Vec3{1.5, 0.62, 0.26}, power(near, 1.3)) *
             (0.65 + 0.5 * hash(3));
    d.opacity = 0.03 + 0.11 * hash(5);
    d.thin = 0.3;
    patch.push_back(d);
  }
  for (int64_t i = 0; i < 130; ++i) {  // the first stars
    const auto hash = [&](int64_t k) { return place.random(93, i, k); };
    const double s = 0.05 + 0.06 * hash(3) * hash(3) * hash(3);
    Dot d = far_dot(unit({hash(0) - 0.5, 0.25 + hash(1), hash(2) - 0.5}), 135, s, s);
    d.emit = {0.8, 0.85, 1.0};
    d.opacity = 0.5;
    d.thin = 0.5;
    patch.push_back(d);
  }
  constexpr double kGlow[4][2] = {{1.9, 0.97}, {5.0, 0.30}, {13.0, 0.22}, {30.0, 0.16}};
  for (const auto& glow : kGlow) {  // the sun
    Dot d = far_dot(sun(), 148 - glow[0], glow[0], glow[0]);
    d.emit = glow[0] < 10 ? Vec3{2.6, 1.15, 0.38} : Vec3{1.5, 0.62, 0.22};
    d.opacity = glow[1];
    d.thin = 0.1;
    patch.push_back(d);
  }
  place.put(patch, [](Dot&) {});
}

void hills(Place& place, double far, double low, double high, double cell, const Vec3& color) {
  cell *= std::max(1.0, place.density * 0.7);
  const int64_t n = static_cast<int64_t>(kTurn * far / cell);
  const uint64_t key = static_cast<uint64_t>(far);
  Patch patch;
  for (int64_t k = 0; k < n; ++k) {
    for (int64_t j = 0; j < 12; ++j) {
      const double turns =
          (static_cast<double>(k) + 0.5 * static_cast<double>(j & 1)) / static_cast<double>(n);
      const Vec3 edge = on_circle(turns, 1);
      double top = low + high * place.noise(edge * far, 17.0 * far / 95, key);
      if (far < 60) top += 1.6 * place.noise(edge * far, 1.7, key + 1);
      Dot d = far_dot(edge, far, cell * 0.75, (top + 3) / 12 * 0.62);
      d.p[1] = -3 + (top + 3) * (static_cast<double>(j) + 0.5) / 12;
      d.v = kUp;
      d.u = cross(kUp, edge * -1);
      const double haze = clamp(dot(edge, sunset()) * 0.5 + 0.5, 0, 1);
      d.emit = mix(color, Vec3{0.55, 0.27, 0.16}, haze * haze * 0.30 * far / 95) *
               (0.85 + 0.3 * place.random(95, k, j));
      d.opacity = 0.97;
      d.thin = 0.1;
      patch.push_back(d);
    }
  }
  place.put(patch, [](Dot&) {});
}

void far_house(Place& place, int64_t k) {
  const auto hash = [&](uint64_t key, int64_t i = 0) { return place.random(key, k, i); };
  const double x = -30 + 60 * hash(98), z = 25 + 12 * hash(99);
  const double w = 5 + 3 * hash(100), h = 4.5 + 2 * hash(101);
  const Vec3 west{-1, 0, 0};
  const Patch front =
      kept(place.rectangle({x, -0.3, z}, west, kUp, w, h + 3, 0.35),
           [&](const Dot& d) { return d.b < h + 3 - std::abs(d.a - w / 2) * 6 / w; });
  const Vec3 dusk = mix(Vec3{0.085, 0.07, 0.085}, Vec3{0.14, 0.08, 0.065}, hash(102));
  place.put(front, [&](Dot& d) {
    d.emit = dusk * ((d.b > h ? 0.75 : 1) * (0.85 + 0.3 * place.random_at(103, d.p)));
    d.kind = Kind::kUnshaded;
  });
  for (int i = 0; i < 6; ++i) {
    if (hash(104, i) >= 0.6) continue;
    const Vec3 corner{x - w * (0.2 + 0.25 * (i % 3)), 1.2 + 2 * (i / 3), z - 0.1};
    place.put(place.rectangle(corner, west, kUp, 0.6, 0.85, 0.3), [&](Dot& d) {
      d.emit = kLit * (0.4 + 0.4 * hash(105, i));
      d.kind = Kind::kUnshaded;
    });
  }
  const Vec3 poplar{-32 + 64 * hash(106), 4.2, 21 + 8 * hash(107)};
  place.put(place.ball(poplar, {0.9, 4.6, 0.9}, 0.42), [&](Dot& d) {
    d.emit = Vec3{0.026, 0.034, 0.028} * (0.7 + 0.7 * place.random_at(108, d.p));
    d.kind = Kind::kUnshaded;
    d.thin = 0.5;
  });
}

void fields(Place& place) {
  constexpr int kRings = 45;
  const double ratio = power(110.0 / 13, 1.0 / kRings);
  double r0 = 13;
  for (int k = 0; k < kRings; ++k, r0 *= ratio) {
    const double cell = std::max(0.7 * std::max(1.0, place.density), 1.2 * r0 * (ratio - 1));
    const Patch ring = kept(
        place.disc(kUp * -0.25, r0, r0 * ratio, cell / place.density),
        [](const Dot& d) { return !(std::abs(d.p[0]) < 13.3 && d.p[2] > -9 && d.p[2] < 12.3); });
    const Vec3 c = mix(Vec3{0.030, 0.042, 0.022}, Vec3{0.07, 0.065, 0.09}, std::min(1.0, r0 / 70));
    place.put(ring, [&](Dot& d) {
      d.emit = c * (0.7 + 0.6 * place.noise(d.p, 1.3 + 0.08 * r0, 96));
      d.kind = Kind::kUnshaded;
      d.thin = 0.05;
    });
  }
}

}  // namespace

void make_surroundings(Place& place) {
  dome(place);
  clouds(place);
  hills(place, 95, 9, 9, 2.6, {0.115, 0.105, 0.19});
  hills(place, 70, 4.5, 5, 2.0, {0.062, 0.062, 0.10});
  hills(place, 48, 1.5, 4.5, 1.2, {0.03, 0.036, 0.04});
  for (int64_t k = 0; k < 16; ++k) far_house(place, k);
  fields(place);
}

}  // namespace l4d::io::synth
