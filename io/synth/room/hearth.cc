// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

constexpr double kX0 = kFirePlace[0] - 0.95, kX1 = kFirePlace[0] + 0.95;  // the breast
constexpr double kFace = kFirePlace[2], kBack = kRoomLow[2];
constexpr double kOpen0 = kFirePlace[0] - 0.46, kOpen1 = kFirePlace[0] + 0.46, kOpenHigh = 0.78;
constexpr double kMantel = 1.14;
const Stand kHere({0, 0, 0}, 0);

constexpr double kCourse = 0.088, kLong = 0.26, kJoint = 0.014;

Vec3 clay(const Place& place, int64_t course, int64_t number) {
  return mix(Vec3{0.27, 0.098, 0.062}, Vec3{0.40, 0.195, 0.12}, place.random(501, course, number)) *
         (0.70 + 0.5 * place.random(502, course, number));
}

// A face of bricks from `o` along `eu`; every second course is shifted by half a brick.
void bricks(Place& place, const Vec3& o, const Vec3& eu, double wide, double high,
            const Opening& hole, int64_t key) {
  const Vec3 n = cross(eu, kUp);
  place.put(place.rectangle(o - n * 0.012, eu, kUp, wide, high, 0.05, 0.12, {hole}), [&](Dot& d) {
    d.albedo = Vec3{0.42, 0.365, 0.295} * (0.8 + 0.4 * place.noise(d.p, 0.06, 503));
  });
  const int courses = static_cast<int>(high / kCourse + 0.5);
  const double tall = high / courses;
  for (int row = 0; row < courses; ++row) {
    const double b = tall * row;
    const int first = row % 2 == 0 ? 0 : -1;
    const auto start = [&](int k) { return kLong * (first < 0 ? k + 0.5 : k); };
    for (int k = first; start(k) < wide; ++k) {
      double a0 = std::max(start(k), 0.0), a1 = std::min(start(k) + kLong, wide);
      if (b + tall > hole.b0 + 0.01 && b < hole.b1 - 0.01) {  // cut at the opening
        if (a0 < hole.a0) a1 = std::min(a1, hole.a0);
        if (a1 > hole.a1) a0 = std::max(a0, hole.a1);
        if (a0 >= hole.a0 - 1e-9 && a1 <= hole.a1 + 1e-9) continue;
      }
      if (a1 - a0 < 0.04) continue;
      const Vec3 color = clay(place, 100 * key + row, k);
      place.put(place.rectangle(o + eu * (a0 + kJoint / 2) + kUp * (b + kJoint / 2), eu, kUp,
                                a1 - a0 - kJoint, tall - kJoint, 0.068, 0.1),
                [&](Dot& d) {
                  d.albedo = color * (0.8 + 0.4 * place.noise(d.p, 0.045, 504));
                  // Wider ones would hide the joints: of a single row, of several.
                  d.sv = d.sv > 0.4 * tall ? 0.36 * tall : std::min(d.sv, 0.21 * tall);
                });
    }
  }
}

void masonry(Place& place) {
  const auto block = [&](double x0, double x1, double y0, double y1, double face,
                         const Opening& hole, int64_t key) {
    bricks(place, {x0, y0, face}, kRight, x1 - x0, y1 - y0, hole, key);
    bricks(place, {x1, y0, face}, kFront * -1, face - kBack, y1 - y0, {}, key + 1);
    bricks(place, {x0, y0, kBack}, kFront, face - kBack, y1 - y0, {}, key + 2);
  };
  block(kX0, kX1, 0, kMantel, kFace, {kOpen0 - kX0, 0, kOpen1 - kX0, kOpenHigh}, 1);
  block(kFirePlace[0] - 0.68, kFirePlace[0] + 0.68, kMantel, kRoomHigh[1], kFace - 0.12,
        {0.22, 1.46 - kMantel + 0.03, 1.14, 1.46 - kMantel + 0.65}, 4);  // where a picture hangs
  const Vec3 brown{0.25, 0.12, 0.08};
  solid(place, kHere, {kX0, 0, kBack}, {kOpen0, kMantel, kFace}, brown);
  solid(place, kHere, {kOpen1, 0, kBack}, {kX1, kMantel, kFace}, brown);
  solid(place, kHere, {kOpen0, kOpenHigh, kBack}, {kOpen1, kMantel, kFace}, brown);
  solid(place, kHere, {kFirePlace[0] - 0.68, kMantel, kBack},
        {kFirePlace[0] + 0.68, kRoomHigh[1], kFace - 0.12}, brown);
  // A lintel of stone, the mantelpiece, the slab before the fire.
  const auto stone = [&](const Vec3& low, const Vec3& high) {
    place.put(crate(place, low, high, 0.045), [&](Dot& d) {
      d.albedo = Vec3{0.36, 0.295, 0.22} * (0.75 + 0.5 * place.noise(d.p, 0.07, 504));
      d.gloss = 0.3;
    });
  };
  stone({kOpen0 - 0.1, kOpenHigh, kFace - 0.05}, {kOpen1 + 0.1, kOpenHigh + 0.13, kFace + 0.02});
  stone({kX0 - 0.05, 0, kFace}, {kX1 + 0.05, 0.035, kFace + 0.42});
  plank(place, kHere, {kX0 - 0.08, kMantel, kBack}, {kX1 + 0.08, kMantel + 0.06, kFace + 0.14},
        0.04, kOak, 0, 505, 0.35);
  // Within: soot, lit by the fire.
  const auto soot = [&](const Vec3& o, const Vec3& eu, const Vec3& ev, double w, double h) {
    place.put(place.rectangle(o, eu, ev, w, h, 0.05), [&](Dot& d) {
      const double near = smooth(0.75, 0.0, d.p[1]);
      d.albedo = {0.05, 0.042, 0.038};
      d.emit = Vec3{0.30, 0.085, 0.018} * (near * (0.4 + 0.9 * place.noise(d.p, 0.12, 506)));
    });
  };
  const double w = kOpen1 - kOpen0, deep = kFace - kBack;
  soot({kOpen0, 0, kBack + 0.04}, kRight, kUp, w, kOpenHigh);
  soot({kOpen0, 0, kFace}, kFront * -1, kUp, deep, kOpenHigh);
  soot({kOpen1, 0, kBack}, kFront, kUp, deep, kOpenHigh);
  soot({kOpen0, kOpenHigh, kBack}, kRight, kFront, w, deep);
  soot({kOpen0, 0.02, kFace}, kRight, kFront * -1, w, deep);
  const auto log = [&](const Vec3& a, const Vec3& b, double r) {
    place.put(with_thickness(place.tube(kFirePlace + a, kFirePlace + b, r, r * 0.9, 0.03), 0.3),
              [&](Dot& d) {
                const double ember = place.noise(d.p, 0.06, 507);
                d.albedo = {0.06, 0.04, 0.03};
                d.emit = Vec3{1.6, 0.36, 0.05} * (smooth(0.5, 0.85, ember));
              });
  };
  log({-0.30, 0.08, -0.24}, {0.30, 0.10, -0.20}, 0.055);
  log({-0.27, 0.08, -0.12}, {0.28, 0.07, -0.15}, 0.05);
  log({-0.20, 0.17, -0.22}, {0.24, 0.19, -0.13}, 0.045);
  log({0.10, 0.14, -0.08}, {-0.16, 0.26, -0.26}, 0.038);
  if (place.counting) return;
  // What mirrors see of the fire.
  solid(place, kHere, {kOpen0 + 0.16, 0.08, kBack + 0.05}, {kOpen1 - 0.16, 0.52, kBack + 0.12},
        {0, 0, 0});
  place.light.occluders.back().emit = {2.4, 0.95, 0.22};
  place.light.lamps.push_back({kFirePlace + Vec3{0, 0.42, 0.05}, 1.6, kFront, true, kFire, 0.16});
  place.light.lamps.push_back({kFirePlace + Vec3{0, 0.30, -0.16}, 0.10, {}, false, kFire});
}

// Tongues of flame, each there for a blink.
void fire(Place& place) {
  constexpr double kBefore = 0.15;  // some burn as the scene begins
  const double span = place.action + 2 * kBefore;
  const int64_t n = std::max<int64_t>(16, place.detailed(900 * span));
  // Where there are more of them they are smaller, so that the fire is as bright.
  const double coarse =
      place.density > 1 ? std::min(2.2, std::sqrt(place.density)) : std::max(0.2, place.density);
  for (int64_t i = 0; i < n; ++i) {
    const auto hash = [&](int64_t k) { return place.random(511, i, k); };
    const double h = hash(1) * std::sqrt(hash(1));
    const double sway =
        0.05 * sin_turns(0.9 * span * static_cast<double>(i) / static_cast<double>(n));
    const Vec3 velocity{(hash(4) - 0.5) * 0.25, 0.6 + 0.5 * hash(5), 0};
    Dot d;
    d.p = kFirePlace + Vec3{((hash(2) + hash(6)) / 2 - 0.5) * 0.72 * (1 - 0.72 * h) + sway * h,
                            0.10 + 0.56 * h, -0.19 + (hash(3) - 0.5) * 0.16};
    d.u = unit(velocity);
    d.v = unit(cross(d.u, kFront));
    d.n = cross(d.u, d.v);
    d.su = 0.062 * (1.15 - 0.55 * h) * coarse;
    d.sv = 0.022 * (1.25 - 0.65 * h) * coarse;
    d.emit = mix(Vec3{2.6, 1.35, 0.36}, Vec3{1.25, 0.27, 0.04}, smooth(0, 0.9, h));
    d.kind = Kind::kUnshaded;
    d.opacity = 0.50 - 0.2 * h;
    d.thin = 1;
    d.velocity = velocity * (1 / place.stretch);
    place.flash(d, span * (static_cast<double>(i) + hash(0)) / static_cast<double>(n) - kBefore,
                (0.03 + 0.03 * hash(7)) * place.stretch);
  }
  // Its light on the stones and boards before it jumps.
  const int64_t blinks = std::max<int64_t>(4, static_cast<int64_t>(7 * place.action));
  for (int64_t i = 0; i < blinks; ++i) {
    const auto hash = [&](int64_t k) { return place.random(512, i, k); };
    const double at =
        place.action * (static_cast<double>(i) + hash(0)) / static_cast<double>(blinks);
    for (int k = 0; k < 3; ++k) {
      Dot d;
      d.p = kFirePlace + Vec3{0.5 * (hash(2 + k) - 0.5), 0.045, 0.12 + 0.30 * k};
      d.v = kFront * -1;
      d.n = kUp;
      d.su = 0.32 + 0.12 * k;
      d.sv = 0.16 + 0.05 * k;
      d.emit = {1.1, 0.42, 0.10};
      d.kind = Kind::kUnshaded;
      d.opacity = 0.10 - 0.025 * k;
      d.thin = 0.02;
      place.flash(d, at, (0.04 + 0.07 * hash(6)) * place.stretch);
    }
  }
}

// Sparks fly up, slow down and go out.
void sparks(Place& place) {
  constexpr double kPiece = 0.14;
  const int64_t n = std::max<int64_t>(4, few(place, 34 * (place.action + 1)));
  for (int64_t i = 0; i < n; ++i) {
    const auto hash = [&](int64_t k) { return place.random(513, i, k); };
    const double birth =
        -1 + (place.action + 1) * (static_cast<double>(i) + hash(0)) / static_cast<double>(n);
    const Vec3 start = kFirePlace + Vec3{0.5 * (hash(1) - 0.5), 0.18 + 0.2 * hash(2), -0.14};
    const Vec3 v0{0.5 * (hash(3) - 0.5), 0.9 + 0.7 * hash(4), 0.25 + 0.35 * hash(5)};
    for (int k = 0; k < 5; ++k) {
      const double age = (k + 0.5) * kPiece, fall = 0.9;
      const Vec3 velocity =
          v0 - kUp * (2 * fall * age) + kRight * (0.3 * sin_turns(hash(6) + 2 * age));
      Dot d;
      d.p = start + v0 * age - kUp * (fall * age * age);
      d.u = unit(velocity);
      d.v = unit(cross(d.u, {0.2, 0.1, 0.9}));
      d.n = cross(d.u, d.v);
      d.su = 0.012;
      d.sv = 0.0045 * std::min(2.0, std::max(1.0, place.density));
      d.emit = mix(Vec3{3.0, 1.5, 0.4}, Vec3{1.1, 0.2, 0.03}, k / 4.0);
      d.kind = Kind::kUnshaded;
      d.opacity = 0.8 - 0.12 * k;
      d.thin = 1;
      d.velocity = velocity * (1 / place.stretch);
      place.flash(d, birth + age, 0.6 * kPiece * place.stretch);
    }
  }
}

// A candle; its flame is a still one with blinks around it.
void candle(Place& place, const Vec3& foot, double high, int64_t number) {
  const Vec3 wick = foot + kUp * (high + 0.035);
  place.still([&] {
    place.put(with_thickness(place.tube(foot, foot + kUp * 0.03, 0.045, 0.03, 0.018), 0.3), kBrass);
    place.put(
        with_thickness(place.tube(foot + kUp * 0.03, foot + kUp * high, 0.016, 0.015, 0.018), 0.4),
        [&](Dot& d) {
          d.albedo = {0.70, 0.62, 0.48};
          d.emit = Vec3{0.30, 0.16, 0.06} * d.b;
        });
    Dot flame = glow(wick, 0.0085, 0.9, {2.8, 1.7, 0.7});
    flame.u = kUp;
    flame.v = kRight;
    flame.su = 0.02;
    flame.n = cross(flame.u, flame.v);
    place.put({flame, glow(wick, 0.05, 0.16, kFire * 1.7),
               glow(wick + kUp * 1e-3, 0.13, 0.045, kFire * 1.7)},
              [](Dot&) {});
    if (!place.counting)
      place.light.lamps.push_back({wick + kFront * 0.03, 0.055, {}, false, kWarm});
  });
  if (!place.flicker) return;
  const int64_t n = std::max<int64_t>(2, static_cast<int64_t>(9 / place.density * place.action));
  for (int64_t i = 0; i < n; ++i) {
    const auto hash = [&](int64_t k) { return place.random(514, number, i, k); };
    const double at = place.action * (static_cast<double>(i) + hash(0)) / static_cast<double>(n);
    const Vec3 off = Vec3{hash(1) - 0.5, hash(2), hash(3) - 0.5} * 0.016;
    const double sigma = (0.03 + 0.05 * hash(4)) * place.stretch;
    place.flash(glow(wick + off, 0.012, 0.6, {3.0, 1.9, 0.8}), at, sigma);
    place.flash(glow(wick + off, 0.085, 0.07, kFire * 2), at, sigma);
  }
}

// A landscape in a gilded frame hangs over the mantelpiece: see pictures. Beside it stand a jug and
// a row of candles.
void on_mantel(Place& place) {
  const Vec3 at{0, kMantel + 0.06, kFace + 0.02};
  candle(place, at + kRight * (kX0 + 0.08), 0.24, 1);
  candle(place, at + kRight * (kX0 + 0.24), 0.17, 2);
  candle(place, at + kRight * (kX1 - 0.10), 0.22, 3);
  place.still([&] {
    const Vec3 jug = at + kRight * (kX1 - 0.34);
    place.put(
        with_thickness(
            turned(place, jug,
                   {{0.05, 0}, {0.085, 0.06}, {0.08, 0.13}, {0.04, 0.19}, {0.055, 0.24}}, 0.02),
            0.25),
        [&](Dot& d) {
          const bool band = d.p[1] > jug[1] + 0.09 && d.p[1] < jug[1] + 0.12;
          d.albedo = band ? Vec3{0.65, 0.6, 0.5} : Vec3{0.05, 0.12, 0.30};
          d.gloss = 0.8;
        });
  });
}

}  // namespace

void make_hearth(Place& place) {
  place.still([&] { masonry(place); });
  on_mantel(place);
  if (place.flicker) fire(place);
  if (place.drops) sparks(place);
}

}  // namespace l4d::io::synth
