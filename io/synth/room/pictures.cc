// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

// Pictures are painted by formula: x from 0 to the width, y from 0 to 1, up.
using Painting = Vec3 (*)(const Place&, double x, double y);

Vec3 hills(const Place& place, double x, double y) {
  const Vec3 sky = mix(Vec3{0.78, 0.50, 0.22}, Vec3{0.22, 0.34, 0.50}, smooth(0.35, 0.95, y));
  const double sx = x - 0.95, sy = y - 0.62;
  Vec3 out = mix(Vec3{0.92, 0.80, 0.48}, sky, smooth(0.08, 0.11, std::sqrt(sx * sx + sy * sy)));
  const double far = 0.46 + 0.07 * sin_turns(0.8 * x + 0.1) + 0.03 * sin_turns(2.1 * x);
  const double middle = 0.33 + 0.06 * sin_turns(0.9 * x + 0.6),
               near = 0.20 + 0.08 * sin_turns(0.5 * x + 0.3);
  if (y < far) out = {0.24, 0.30, 0.36};
  if (y < middle)
    out = mix(Vec3{0.20, 0.27, 0.10}, Vec3{0.38, 0.36, 0.12}, place.noise({x, y, 0}, 0.12, 701));
  if (y < near) out = {0.07, 0.13, 0.06};
  const double river = std::abs(x - 0.5 - 0.22 * sin_turns(1.4 * y)) - 0.10 * (0.42 - y);
  if (y < middle && river < 0) out = {0.55, 0.50, 0.40};
  return out;
}

Vec3 ship(const Place& place, double x, double y) {
  Vec3 out = mix(Vec3{0.52, 0.55, 0.50}, Vec3{0.18, 0.30, 0.42}, y) *
             (0.85 + 0.3 * place.noise({x, y, 1}, 0.2, 702));
  const double sea = 0.28 + 0.02 * sin_turns(3 * x);
  if (y < sea)
    out = mix(Vec3{0.04, 0.11, 0.15}, Vec3{0.14, 0.26, 0.28}, place.noise({x, 3 * y, 2}, 0.1, 703));
  if (y > 0.24 && y < 0.34 && x > 0.22 + 0.5 * (0.34 - y) && x < 0.60 - 0.6 * (0.34 - y))
    out = {0.12, 0.06, 0.03};
  if (x < 0.42 && y > 0.36 && y < 0.82 && x > 0.42 - 0.5 * (0.84 - y)) out = {0.72, 0.66, 0.52};
  if (x > 0.44 && y > 0.36 && y < 0.74 && x < 0.44 + 0.45 * (0.76 - y)) out = {0.62, 0.50, 0.36};
  return out;
}

Vec3 pears(const Place&, double x, double y) {
  Vec3 out =
      y < 0.36 ? Vec3{0.26, 0.15, 0.08} : mix(Vec3{0.10, 0.08, 0.06}, Vec3{0.17, 0.13, 0.08}, x);
  for (const auto& [cx, r, tint] :
       {std::tuple{0.26, 0.13, 0.0}, std::tuple{0.52, 0.15, 1.0}, std::tuple{0.41, 0.11, 0.5}}) {
    const double base = 0.28 + r, low = radius_of(x - cx, (y - base) * 0.95);
    const double top = radius_of(x - cx - 0.02, y - base - 1.05 * r) - 0.45 * r;
    const double inside = std::min(low - r, top);
    if (inside > 0) continue;
    const double lit = clamp(0.75 - 1.6 * (x - cx + 0.05) + 0.6 * (y - base), 0.25, 1.3);
    out = mix(Vec3{0.46, 0.42, 0.08}, Vec3{0.56, 0.20, 0.06}, tint) * lit;
  }
  return out;
}

Vec3 moonlight(const Place& place, double x, double y) {
  const double r = radius_of(x - 0.3, y - 0.74);
  Vec3 out =
      mix(Vec3{0.80, 0.78, 0.60}, Vec3{0.05, 0.10, 0.20} * (1 + 0.5 * y), smooth(0.09, 0.13, r));
  if (y < 0.36) {
    const double glint = std::abs(x - 0.3) < 0.10 + 0.05 * sin_turns(9 * y) ? 0.5 : 0.06;
    out = mix(Vec3{0.03, 0.06, 0.12}, Vec3{0.55, 0.52, 0.40}, glint);
  }
  const double pine = std::abs(x - 0.66) - 0.16 * (0.86 - y) * (0.7 + 0.3 * sin_turns(7 * y));
  if (pine < 0 && y < 0.86) out = {0.02, 0.04, 0.035};
  return out * (0.9 + 0.2 * place.noise({x, y, 4}, 0.05, 704));
}

// In its frame, against a wall: the stand is the middle of the lower edge.
void hang(Place& place, const Stand& stand, double wide, double high, Painting paint,
          const Vec3& gilt) {
  constexpr double kFrame = 0.07;
  const Patch canvas = place.rectangle({-wide / 2, 0, 0.022}, kRight, kUp, wide, high, 0.021, 0.3);
  place.put(stand(canvas), [&](Dot& d) { d.albedo = paint(place, d.a / high, d.b / high); });
  place.put(stand(place.rectangle({-wide / 2, 0, 0}, kRight, kUp, wide, high, 0.07)),
            paint(place, 0.1, 0.3));
  for (const auto& [x, y, dx, dy] :
       {std::tuple{-wide / 2 - kFrame, -kFrame, wide + 2 * kFrame, kFrame},
        std::tuple{-wide / 2 - kFrame, high, wide + 2 * kFrame, kFrame},
        std::tuple{-wide / 2 - kFrame, 0.0, kFrame, high},
        std::tuple{wide / 2, 0.0, kFrame, high}}) {
    const bool level = dx > dy;
    const double low = y, tall = dy;  // clang 14 captures no bindings
    const int64_t key = static_cast<int64_t>(100 * (x + 9) + 10 * y);
    place.put(stand(crate(place, {x, y, 0}, {x + dx, y + dy, 0.045}, 0.03)), [&](Dot& d) {
      const double across = level ? (stand(Vec3{0, low, 0})[1] + tall / 2 - d.p[1]) / kFrame : 0;
      d.albedo = gilt * (0.72 + 0.25 * sin_turns(2 * across) +
                         0.25 * place.noise(d.p, 0.03, 710 + static_cast<uint64_t>(key % 7)));
      d.gloss = 0.5;
    });
  }
}

}  // namespace

void make_pictures(Place& place) {
  const Vec3 gold{0.56, 0.37, 0.12}, dark{0.16, 0.085, 0.045};
  hang(place, Stand({kFirePlace[0], 1.46, kFirePlace[2] - 0.12}, 0), 0.98, 0.68, hills, gold);
  hang(place, Stand({kRoomHigh[0], 1.50, -1.15}, -0.25), 0.56, 0.72, ship, gold);
  hang(place, Stand({kRoomHigh[0], 1.62, -2.05}, -0.25), 0.46, 0.40, pears, dark);
  hang(place, Stand({-1.35, 1.48, kRoomHigh[2]}, 0.5), 0.86, 0.66, moonlight, gold);
  hang(place, Stand({-2.75, 1.52, kRoomHigh[2]}, 0.5), 0.46, 0.40, pears, dark);
  hang(place, Stand({0.35, 1.50, kRoomHigh[2]}, 0.5), 0.50, 0.66, ship, dark);
}

}  // namespace l4d::io::synth
