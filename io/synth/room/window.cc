// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

constexpr double kWallX = kRoomLow[0];
constexpr double kMiddle = (kWindow.z0 + kWindow.z1) / 2;
const Stand kHere({0, 0, 0}, 0);

Vec3 evening(const Place& place, const Vec3& p) {
  const double cloud = place.noise(p * Vec3{1, 2.4, 1}, 2.6, 401) * 0.6 +
                       place.noise(p * Vec3{1, 3.0, 1}, 0.9, 402) * 0.4;
  const double up = p[1] + 1.4 * (cloud - 0.5);
  const Vec3 low = mix(Vec3{0.95, 0.40, 0.16}, Vec3{0.42, 0.26, 0.36}, smooth(0.9, 2.6, up));
  const Vec3 sky = mix(low, Vec3{0.075, 0.11, 0.25}, smooth(2.0, 5.2, up));
  return sky * (0.72 + 0.5 * cloud);
}

// A quiet slope under the last light, with a village: all of it only shines.
void outside(Place& place) {
  const auto paint = [](const Vec3& color) {
    return [=](Dot& d) {
      d.emit = color;
      d.kind = Kind::kUnshaded;
    };
  };
  Patch backdrop = place.rectangle({-11, -1.5, 16}, kFront * -1, kUp, 32, 9.5, 0.34);
  place.put(backdrop, [&](Dot& d) {
    d.su *= 1.3;
    d.sv *= 1.3;
    const double hill = 0.75 + 0.35 * sin_turns(0.07 * d.p[2] + 0.1) +
                        0.13 * sin_turns(0.19 * d.p[2]) + 0.12 * place.noise(d.p, 0.4, 403);
    d.emit = d.p[1] < hill ? mix(Vec3{0.020, 0.028, 0.045}, Vec3{0.075, 0.075, 0.11},
                                 smooth(hill - 1.6, hill, d.p[1]))
                           : evening(place, d.p);
    d.kind = Kind::kUnshaded;
  });
  for (int k = 0; k < 7; ++k) {  // houses
    const auto hash = [&](int64_t i) { return place.random(404, k, i); };
    const double z = -11 + 3.3 * k + 1.2 * hash(0), wide = 1.1 + 0.5 * hash(1),
                 tall = 0.75 + 0.4 * hash(2);
    const double x = -9.6 + 0.8 * hash(3), y = 0.1 - 0.3 * hash(4);
    place.put(place.rectangle({x, -2, z + wide / 2}, kFront * -1, kUp, wide, tall + y + 2, 0.14),
              paint({0.030, 0.032, 0.05}));
    const Patch gable = place.rectangle({x, y + tall - 0.02, z + wide / 2}, kFront * -1, kUp, wide,
                                        wide * 0.42, 0.09);
    for (const double s : {-1.0, 1.0}) {  // its edges
      const Vec3 foot{x + 0.01, y + tall - 0.05, z + s * (wide / 2 + 0.06)};
      const Vec3 slope = unit({0, 0.84, 0.0 - s});
      Patch edge = slab(place, foot, slope, cross(kRight, slope), 0.653 * wide + 0.06, 0.05, 0.1);
      place.put(edge, paint({0.035, 0.028, 0.038}));
    }
    place.put(
        kept(gable, [&](const Dot& d) { return d.b < 0.84 * std::min(d.a, wide - d.a) + 0.01; }),
        paint({0.042, 0.032, 0.042}));
    for (int w = 0; w < 3; ++w) {
      if (hash(10 + w) < 0.35) continue;
      place.put(slab(place, {x + 0.03, y + 0.25 + 0.22 * (w % 2), z + wide * (0.32 - 0.3 * w)},
                     kFront * -1, kUp, 0.16, 0.2, 0.11),
                paint(Vec3{1.0, 0.58, 0.20} * (0.8 + 0.9 * hash(20 + w))));
    }
  }
  // A bare tree near the house.
  const Vec3 foot{-6.4, -1.5, -1.9};
  const auto branch = [&](const Vec3& a, const Vec3& b, double r0, double r1) {
    place.put(with_thickness(place.tube(foot + a, foot + b, r0, r1, 0.09), 0.5),
              paint({0.022, 0.020, 0.026}));
  };
  branch({0, 0, 0}, {0.05, 2.7, 0.1}, 0.075, 0.04);
  branch({0.05, 2.68, 0.1}, {0.08, 3.5, -0.02}, 0.038, 0.02);
  branch({0.08, 3.48, -0.02}, {0.0, 4.4, 0.12}, 0.02, 0.006);
  for (int k = 0; k < 6; ++k) {
    const double y = 2.0 + 0.22 * k, side = k % 2 == 0 ? 1 : -1;
    const double out = 0.95 - 0.05 * k + 0.3 * place.random(405, k);
    const Vec3 from{0.04, y - 0.25, 0.08}, tip{0.3 * place.random(406, k), y + 0.85, side * out};
    const Vec3 bend = mix(from, tip, 0.45) - Vec3{0, 0.10, side * -0.07};
    branch(from, bend, 0.022, 0.014);
    branch(bend, tip, 0.014, 0.006);
    for (int t = 0; t < 2; ++t) {
      const Vec3 start = mix(bend, tip, 0.25 + 0.3 * t);
      branch(start, start + Vec3{0.1, 0.42, side * (0.1 + 0.25 * place.random(407, k, t))}, 0.009,
             0.004);
    }
  }
}

void frame(Place& place) {
  constexpr double kDeep = 0.16;
  const double z0 = kWindow.z0, z1 = kWindow.z1, y0 = kWindow.y0, y1 = kWindow.y1;
  const double x0 = kWallX - kDeep;
  const auto white = [&](const Patch& patch) { place.put(patch, kWhitePaint); };
  // The reveal: left and right, below and above.
  white(slab(place, {x0, y0, z0}, kRight, kUp, kDeep, y1 - y0, 0.05));
  white(slab(place, {kWallX, y0, z1}, {-1, 0, 0}, kUp, kDeep, y1 - y0, 0.05));
  white(slab(place, {x0, y0, z1}, kRight, kFront * -1, kDeep, z1 - z0, 0.05));
  white(slab(place, {x0, y1, z0}, kRight, kFront, kDeep, z1 - z0, 0.05));
  // The casing around it, and a sill.
  for (const auto& [z, y, dz, dy] :
       {std::tuple{z1 + 0.1, y1, z1 - z0 + 0.2, 0.1}, std::tuple{z1 + 0.1, y0, 0.1, y1 - y0},
        std::tuple{z0, y0, 0.1, y1 - y0}, std::tuple{z1 + 0.1, y0 - 0.1, z1 - z0 + 0.2, 0.1}}) {
    white(slab(place, {kWallX + 0.03, y, z}, kFront * -1, kUp, dz, dy, 0.06));
  }
  white(crate(place, {kWallX, y0 - 0.04, z0 - 0.12}, {kWallX + 0.08, y0, z1 + 0.12}, 0.06));
  // Bars of the sash.
  const auto bar = [&](double za, double zb, double ya, double yb) {
    white(crate(place, {x0 + 0.02, ya, za}, {x0 + 0.07, yb, zb}, 0.06));
  };
  const double wide = (z1 - z0) / 3;
  for (int k = 0; k <= 3; ++k) {
    const double half = k == 0 || k == 3 ? 0.045 : 0.024;
    bar(z0 + wide * k - half, z0 + wide * k + half, y0, y1);
  }
  for (const double y : {y0 + 0.03, y0 + 0.83, y1 - 0.03}) bar(z0, z1, y - 0.026, y + 0.026);
}

// A curtain from its rod: gathered in folds, it stirs in the draught, most at its free hem.
struct Curtain {
  double z, side;  // the outer edge, and which way the cloth goes from there
  double folds;    // a metre

  Vec3 at(double a, double b, double t) const {
    constexpr double kHigh = 2.38;
    const double hem = 1 - b / kHigh;
    const double breath =
        sin_turns(0.23 * t + 0.35 * a - 0.15 * b) + 0.5 * sin_turns(0.41 * t - 0.6 * a + 0.2 * b);
    const double fold = 0.042 * sin_turns(folds * a + 0.25 * hem * sin_turns(0.23 * t)) +
                        0.012 * sin_turns(11.3 * a + 0.7 * b);
    const double x = 0.15 + fold + (0.012 + 0.055 * hem * (0.3 + a)) * (0.6 + breath);
    return {kWallX + x, 0.06 + b, z + side * a * (1 + 0.10 * hem * (0.5 + 0.25 * breath))};
  }
  Dot pose(Dot d, double t) const {
    constexpr double kStep = 1e-3;
    d.p = at(d.a, d.b, t);
    const Vec3 along = at(d.a + kStep, d.b, t) - d.p;
    d.u = unit(along);
    d.su *= length(along) / kStep;  // on the flanks of a fold there is more cloth
    const Vec3 v = at(d.a, d.b + kStep, t) - d.p;
    d.v = unit(v - d.u * dot(d.u, v));
    d.n = cross(d.u, d.v);
    if (d.n[0] < 0) {  // to the room
      d.u = d.u * -1;
      d.n = d.n * -1;
    }
    return d;
  }
};

void curtains(Place& place) {
  if (!place.deform && !place.is_static) return;
  constexpr double kWide = 0.62, kHigh = 2.38;
  const double folds = place.density > 1.2 ? 4.3 : 6.2;  // as many as cells can show
  const auto dye = [&](Dot& d) {
    const double fold = sin_turns(folds * d.a);
    const double band = d.b > 0.16 && d.b < 0.24 ? 1 : 0;
    const Vec3 cloth = mix(Vec3{0.42, 0.075, 0.06}, Vec3{0.60, 0.42, 0.16}, band);
    d.albedo = cloth * (0.80 + 0.22 * fold);
    d.opacity = 0.985;
  };
  for (const Curtain& curtain :
       {Curtain{kWindow.z0 - 0.46, 1, folds}, Curtain{kWindow.z1 + 0.46, -1, folds}}) {
    const Patch cloth = threads(place, {0, 0, 0}, kRight, kUp, kWide, kHigh, 0.026, 4);
    const auto pose = [&](const Dot& d, double t) { return curtain.pose(d, t); };
    if (place.deform) {
      place.chain(cloth, 0.55, 0.6, pose, dye);
      continue;
    }
    Patch hanging = cloth;
    for (Dot& d : hanging) d = pose(d, 0);
    place.put(hanging, dye);
  }
}

// Streaks that fall past the window, and drops that run down the panes.
void rain(Place& place) {
  const int64_t falling = std::max<int64_t>(8, few(place, 200 * (place.action + 1)));
  for (int64_t i = 0; i < falling; ++i) {
    const auto hash = [&](int64_t k) { return place.random(411, i, k); };
    const double far = hash(1), speed = 5.2 + 0.8 * hash(2);
    Dot d;
    d.p = {kWallX - 0.45 - 3.2 * far, 0.4 + 2.6 * hash(3),
           kMiddle + (hash(4) - 0.5) * (4 + 4 * far)};
    const Vec3 velocity{0, 0.0 - speed, 0.45 * speed * (0.3 + 0.1 * hash(5))};
    d.u = unit(velocity);
    d.v = unit(cross(d.u, kRight));
    d.n = cross(d.u, d.v);
    d.su = 0.10 + 0.05 * hash(6);
    d.sv = 0.0035 * (1 + far) * std::min(2.0, std::max(1.0, place.density));
    d.emit = Vec3{0.42, 0.46, 0.60} * (0.6 + 0.7 * hash(7));
    d.kind = Kind::kUnshaded;
    d.opacity = 0.32;
    d.thin = 1;
    d.velocity = velocity * (1 / place.stretch);
    place.flash(d,
                -0.5 + (place.action + 1) * (static_cast<double>(i) + hash(0)) /
                           static_cast<double>(falling),
                0.05 * place.stretch);
  }
  constexpr int kPieces = 5;
  constexpr double kPiece = 0.36;
  const int64_t running = std::max<int64_t>(4, few(place, 45 * (place.action + 2)));
  for (int64_t i = 0; i < running; ++i) {
    const auto hash = [&](int64_t k) { return place.random(412, i, k); };
    const double birth =
        -2 + (place.action + 2) * (static_cast<double>(i) + hash(0)) / static_cast<double>(running);
    Vec3 p{kWallX - 0.10, kWindow.y0 + (kWindow.y1 - kWindow.y0) * (0.1 + 0.9 * hash(1)),
           kWindow.z0 + (kWindow.z1 - kWindow.z0) * hash(2)};
    for (int k = 0; k < kPieces; ++k) {  // waits, then runs ever faster
      const double speed = k < 2 ? 0.01 : 0.14 * (k - 1) * (0.5 + hash(3));
      const Vec3 velocity{0, 0.0 - speed, 0.25 * speed * (hash(4 + k) - 0.5)};
      Dot d;
      d.p = p + velocity * (kPiece / 2);
      p = p + velocity * kPiece;
      if (d.p[1] < kWindow.y0 + 0.05) break;
      d.u = unit(velocity);
      d.v = unit(cross(d.u, kRight));
      d.n = cross(d.u, d.v);
      d.su = 0.007 + 0.05 * speed;
      d.sv = 0.0055 * std::min(1.6, std::max(1.0, place.density));
      d.emit = mix(Vec3{0.30, 0.36, 0.52}, Vec3{0.95, 0.66, 0.42}, hash(20) * hash(20)) * 0.8;
      d.kind = Kind::kUnshaded;
      d.opacity = 0.55;
      d.thin = 0.5;
      d.velocity = velocity * (1 / place.stretch);
      place.flash(d, birth + (k + 0.5) * kPiece, 0.6 * kPiece * place.stretch);
    }
  }
}

}  // namespace

void make_window(Place& place) {
  place.still([&] {
    outside(place);
    frame(place);
    // The curtains' rod.
    const Vec3 low{kWallX + 0.15, 2.50, kWindow.z0 - 0.55},
        high{kWallX + 0.15, 2.50, kWindow.z1 + 0.55};
    place.put(with_thickness(place.tube(low, high, 0.018, 0.018, 0.05), 0.5), kBrass);
    for (const Vec3& end : {low, high}) {
      place.put(with_thickness(place.ball(end, {0.036, 0.036, 0.036}, 0.025), 0.4), kBrass);
    }
    if (place.counting) return;
    place.light.lamps.push_back({{kWallX + 0.05, 1.75, kMiddle}, 0.34, kRight, true, kDusk, 0.55});
    solid(place, kHere, {kWallX - 0.4, kWindow.y0, kWindow.z0},
          {kWallX - 0.2, kWindow.y1, kWindow.z1}, {0, 0, 0});
    place.light.occluders.back().emit = {0.75, 0.60, 0.85};
  });
  curtains(place);
  if (place.drops) rain(place);
}

}  // namespace l4d::io::synth
