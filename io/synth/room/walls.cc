// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

constexpr double kRail = 0.98;  // height of the wainscot

// A wall seen from within: from its lower left corner. What hides it has holes there.
struct Wall {
  Vec3 corner, along;
  double length;
  std::vector<Opening> holes;
  uint64_t key;
};

Vec3 paper(const Place& place, const Dot& d) {
  return Vec3{0.205, 0.255, 0.195} * (0.93 + 0.14 * place.noise(d.p, 0.5, 311));
}

Vec3 panelling(const Place& place, const Dot& d) {
  return wood(place, d.p, Vec3{0.24, 0.135, 0.066}, 1, 312);
}

bool hidden(const Wall& wall, double a, double b) {
  return std::any_of(wall.holes.begin(), wall.holes.end(), [&](const Opening& hole) {
    return a > hole.a0 && a < hole.a1 && b > hole.b0 && b < hole.b1;
  });
}

// Sprigs of the wallpaper: a blossom between two leaves, in a lattice whose second rows are
// shifted. Each is made of few long Gaussians, so that it is crisp however coarse the wall is.
void sprigs(Place& place, const Wall& wall, const Vec3& n) {
  if (place.density > 2.5) return;  // other things need the Gaussians more
  constexpr double kAcross = 0.27, kAlong = 0.235, kTop = 2.66;
  const auto petal = [&](const Vec3& at, double turns, double out, double su, double sv,
                         const Vec3& color) {
    Dot d;
    const Vec3 way = wall.along * cos_turns(turns) + kUp * sin_turns(turns);
    d.p = at + way * out;
    d.u = way;
    d.v = cross(n, way);
    d.n = n;
    d.su = su;
    d.sv = sv;
    d.opacity = 0.85;
    place.put({d}, color);
  };
  const Vec3 leaf{0.10, 0.15, 0.09}, blossom{0.50, 0.42, 0.22};
  int row = 0;
  for (double b = kRail + 0.16; b < kTop; b += kAlong, ++row) {
    for (double a = row % 2 == 0 ? 0.14 : 0.14 + kAcross / 2; a < wall.length - 0.08;
         a += kAcross) {
      if (hidden(wall, a, b)) continue;
      const Vec3 at = wall.corner + wall.along * a + kUp * b + n * 0.004;
      petal(at, -0.25, 0.036, 0.020, 0.0035, leaf);
      petal(at, -0.12, 0.038, 0.017, 0.0075, leaf);
      petal(at, -0.38, 0.038, 0.017, 0.0075, leaf);
      for (int k = 0; k < 3; ++k) petal(at, 0.07 + 0.18 * k, 0.014, 0.011, 0.0075, blossom);
    }
  }
}

// A panel of the wainscot: bevels that are dark above and light below.
void panel(Place& place, const Wall& wall, const Vec3& n, double a0, double a1) {
  constexpr double kLow = 0.24, kHigh = kRail - 0.12, kWide = 0.022;
  if (hidden(wall, (a0 + a1) / 2, 0.5) || hidden(wall, a0, 0.5) || hidden(wall, a1, 0.5)) return;
  const auto strip = [&](double a, double b, double w, double h, double shade) {
    const Patch patch = slab(place, wall.corner + n * 0.012 + wall.along * a + kUp * b, wall.along,
                             kUp, w, h, 0.11);
    place.put(patch, [&](Dot& d) { d.albedo = Vec3{0.24, 0.135, 0.066} * shade; });
  };
  strip(a0, kHigh, a1 - a0, kWide, 0.34);
  strip(a0, kLow - kWide, a1 - a0, kWide, 1.75);
  strip(a0 - kWide, kLow, kWide, kHigh - kLow, 0.5);
  strip(a1, kLow, kWide, kHigh - kLow, 1.4);
}

void build_wall(Place& place, const Wall& wall) {
  const Vec3 n = cross(wall.along, kUp);
  const double high = kRoomHigh[1];
  const auto lifted = [&](double low, double top) {  // holes as a part of the wall sees them
    std::vector<Opening> out;
    for (const Opening& h : wall.holes) {
      if (h.b1 > low && h.b0 < top) out.push_back({h.a0, h.b0 - low, h.a1, h.b1 - low});
    }
    return out;
  };
  const Patch lower = place.rectangle(wall.corner, wall.along, kUp, wall.length, kRail, 0.078, 0.12,
                                      lifted(0, kRail));
  place.put(lower, [&](Dot& d) {
    d.albedo = panelling(place, d);
    d.gloss = 0.25;
  });
  const Patch upper = place.rectangle(wall.corner + kUp * kRail, wall.along, kUp, wall.length,
                                      high - kRail, 0.08, 0.12, lifted(kRail, high));
  place.put(upper, [&](Dot& d) { d.albedo = paper(place, d); });
  const Patch behind = place.rectangle(wall.corner - n * 0.06, wall.along, kUp, wall.length, high,
                                       0.15, 0.12, wall.holes);
  place.put(behind, [&](Dot& d) {
    d.albedo = d.p[1] < kRail ? panelling(place, d) : Vec3{0.22, 0.265, 0.20};
  });
  // Strips along the wall, between holes.
  const auto course = [&](double y, double tall, double out, const Vec3& color) {
    constexpr double kStep = 0.1;
    const int steps = static_cast<int>(wall.length / kStep);
    int from = -1;
    for (int k = 0; k <= steps; ++k) {
      const bool on = k < steps && !hidden(wall, (k + 0.5) * kStep, y + tall / 2);
      if (on && from < 0) from = k;
      if (on || from < 0) continue;
      const Patch face = slab(place, wall.corner + n * out + wall.along * (from * kStep) + kUp * y,
                              wall.along, kUp, (k - from) * kStep, tall, 0.075);
      place.put(face, [&](Dot& d) { d.albedo = color; });
      const Patch top =
          slab(place, wall.corner + n * out + wall.along * (from * kStep) + kUp * (y + tall),
               wall.along, n * -1, (k - from) * kStep, out, 0.075);
      place.put(top, [&](Dot& d) { d.albedo = color * 1.15; });
      from = -1;
    }
  };
  course(0, 0.13, 0.02, kWalnut * 1.3);
  course(kRail - 0.03, 0.055, 0.028, kWalnut * 1.5);
  course(high - 0.1, 0.1, 0.05, kWhitePaint);
  sprigs(place, wall, n);
  const int panels = static_cast<int>(wall.length / 0.56);
  const double wide = wall.length / panels;
  for (int k = 0; k < panels; ++k) panel(place, wall, n, wide * k + 0.08, wide * (k + 1) - 0.08);
}

}  // namespace

void make_walls(Place& place) {
  const Vec3 low = kRoomLow, high = kRoomHigh;
  const double w = high[0] - low[0], d = high[2] - low[2];
  // North: the hearth and the shelves hide the wall. East: pictures and shelves. South: the door,
  // pictures, the sideboard. West: the window.
  build_wall(place, {{low[0], 0, low[2]},
                     kRight,
                     w,
                     {{0.05, 0.02, 1.65, 2.22}, {2.66, 0, 4.54, 1.12}, {2.92, 1.1, 4.28, 2.8}},
                     1});
  build_wall(place, {{high[0], 0, low[2]},
                     kFront,
                     d,
                     {{1.34, 1.47, 1.96, 2.25}, {0.49, 1.59, 1.01, 2.05}, {4.40, 0.02, 5.50, 2.18}},
                     2});
  build_wall(place, {{high[0], 0, high[2]},
                     {-1, 0, 0},
                     w,
                     {{1.18, 0, 2.22, 2.15},
                      {4.29, 1.45, 5.21, 2.17},
                      {5.89, 1.49, 6.41, 1.95},
                      {2.77, 1.47, 3.33, 2.19},
                      {4.10, 0.14, 5.80, 0.84}},
                     3});
  build_wall(place, {{low[0], 0, high[2]},
                     {0, 0, -1},
                     d,
                     {{high[2] - kWindow.z1, kWindow.y0, high[2] - kWindow.z0, kWindow.y1}},
                     4});
}

}  // namespace l4d::io::synth
