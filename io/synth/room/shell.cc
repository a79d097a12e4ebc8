// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {
namespace {

const Stand kRoom({0, 0, 0}, 0);

void floorboards(Place& place) {
  constexpr double kBoard = 0.15, kLong = 1.7, kGap = 0.004;
  // Boards below the rug would only shine through it.
  const double rim = clamp(0.11 - 0.05 * place.density, 0, 0.06);
  const auto shown = [&](const Dot& d) {
    return d.p[0] < kRugX0 + rim || d.p[0] > kRugX1 - rim || d.p[2] < kRugZ0 + rim ||
           d.p[2] > kRugZ1 - rim;
  };
  const int rows = static_cast<int>((kRoomHigh[2] - kRoomLow[2]) / kBoard);
  for (int row = 0; row < rows; ++row) {
    const double z = kRoomLow[2] + kBoard * (row + 1);
    double x = kRoomLow[0] - kLong * place.random(301, row);
    for (int k = 0; x < kRoomHigh[0]; ++k, x += kLong) {
      const double a = std::max(x, kRoomLow[0]), b = std::min(x + kLong, kRoomHigh[0]);
      if (b - a < 0.05) continue;
      const Patch board = place.rectangle({a, 0, z - kGap}, kRight, kFront * -1, b - a - kGap,
                                          kBoard - kGap, 0.085, 0.12);
      const double tint = 0.74 + 0.5 * place.random(302, row, k);
      place.put(kept(board, shown), [&](Dot& d) {
        d.albedo = wood(place, d.p + kUp * (0.4 * k), Vec3{0.30, 0.165, 0.078} * tint, 0, 303);
        d.gloss = 0.75;
      });
    }
  }
  // Joints are thin long Gaussians: gaps alone would not show.
  const double step = 0.30 * std::max(place.density, 0.5);
  for (int row = 1; row < rows; ++row) {
    for (double x = kRoomLow[0] + step / 2; x < kRoomHigh[0]; x += step) {
      Dot d;
      d.p = {x, 0.0015, kRoomLow[2] + kBoard * row - kGap / 2};
      d.v = kFront * -1;
      d.n = kUp;
      d.su = 0.62 * step;
      d.sv = 0.0034;
      d.opacity = 0.75;
      if (shown(d)) place.put({d}, Vec3{0.055, 0.028, 0.013});
    }
  }
  place.put(kept(place.rectangle({kRoomLow[0], -0.03, kRoomHigh[2]}, kRight, kFront * -1,
                                 kRoomHigh[0] - kRoomLow[0], kRoomHigh[2] - kRoomLow[2], 0.16),
                 shown),
            Vec3{0.05, 0.028, 0.014});
}

void ceiling(Place& place) {
  constexpr double kHalf = 0.09;  // width of a beam
  const double w = kRoomHigh[0] - kRoomLow[0], d = kRoomHigh[2] - kRoomLow[2];
  const auto plaster = [&](Dot& dot) {
    dot.albedo = Vec3{0.56, 0.51, 0.42} * (0.94 + 0.12 * place.noise(dot.p, 0.6, 321));
  };
  const Vec3 corner{kRoomLow[0], kRoomHigh[1], kRoomLow[2]};
  place.put(place.rectangle(corner + kUp * 0.06, kRight, kFront, w, d, 0.17, 0.12), plaster);
  double from = kRoomLow[2];
  for (const double to : {-1.75 - kHalf, 0.25 - kHalf, 2.25 - kHalf, kRoomHigh[2]}) {
    place.put(
        place.rectangle({corner[0], corner[1], from}, kRight, kFront, w, to - from, 0.1, 0.12),
        plaster);  // up to the next beam, so that its edges are sharp
    from = to + 2 * kHalf;
  }
  for (const double z : {-1.75, 0.25, 2.25}) {
    put_wood(place,
             crate(place, {kRoomLow[0], kRoomHigh[1] - 0.17, z - kHalf},
                   {kRoomHigh[0], kRoomHigh[1] - 0.001, z + kHalf}, 0.075),
             kWalnut * 1.35, 0, 322, 0);
    solid(place, kRoom, {kRoomLow[0], kRoomHigh[1] - 0.17, z - kHalf},
          {kRoomHigh[0], kRoomHigh[1], z + kHalf}, kWalnut);
  }
}

// A door with four panels, in the south wall.
void door(Place& place) {
  constexpr double kX0 = 1.25, kX1 = 2.15, kTop = 2.08;
  const double z = kRoomHigh[2];
  const Vec3 west{-1, 0, 0};
  const Vec3 paint{0.40, 0.36, 0.28};
  place.put(place.rectangle({kX1, 0, z - 0.02}, west, kUp, kX1 - kX0, kTop, 0.06, 0.12),
            [&](Dot& d) { d.albedo = paint * (0.92 + 0.16 * place.noise(d.p, 0.2, 331)); });
  for (const double a : {0.12, 0.52}) {
    for (const auto& panel : {std::pair{0.22, 0.85}, std::pair{1.05, 1.92}}) {
      const double b0 = panel.first, b1 = panel.second;  // clang 14 captures no binding
      const auto strip = [&](double da, double db, double w, double h, double shade) {
        place.put(slab(place, {kX1 - a - da, b0 + db, z - 0.034}, west, kUp, w, h, 0.1),
                  paint * shade);
      };
      strip(0, b1 - b0 - 0.02, 0.27, 0.02, 0.45);
      strip(0, 0, 0.27, 0.02, 1.5);
      strip(0, 0.02, 0.02, b1 - b0 - 0.04, 0.6);
      strip(0.25, 0.02, 0.02, b1 - b0 - 0.04, 1.3);
    }
  }
  for (const auto& [x, w, y, h] :
       {std::tuple{kX1 + 0.1, 0.1, 0.0, kTop + 0.1}, std::tuple{kX0, 0.1, 0.0, kTop + 0.1},
        std::tuple{kX1, kX1 - kX0, kTop, 0.1}}) {
    put_wood(place, slab(place, {x, y, z - 0.04}, west, kUp, w, h, 0.06), kWalnut * 1.5, 1, 332);
  }
  place.put(
      with_thickness(place.ball({kX0 + 0.1, 1.0, z - 0.07}, {0.032, 0.032, 0.032}, 0.02), 0.3),
      kBrass);
}

}  // namespace

void make_shell(Place& place) {
  const Vec3 low = kRoomLow, high = kRoomHigh;
  floorboards(place);
  ceiling(place);
  door(place);
  // For mirrors and openness: the room's hull, from within.
  const double far = 0.2;
  const Vec3 paint{0.24, 0.25, 0.18};
  solid(place, kRoom, low - Vec3{far, far, far}, {high[0] + far, 0, high[2] + far},
        {0.24, 0.13, 0.065});
  solid(place, kRoom, {low[0] - far, high[1], low[2] - far}, high + Vec3{far, far, far},
        {0.55, 0.50, 0.42});
  solid(place, kRoom, {low[0] - far, 0, low[2] - far}, {high[0] + far, high[1], low[2]}, paint);
  solid(place, kRoom, {low[0] - far, 0, high[2]}, {high[0] + far, high[1], high[2] + far}, paint);
  solid(place, kRoom, {high[0], 0, low[2]}, {high[0] + far, high[1], high[2]}, paint);
  solid(place, kRoom, {low[0] - far, 0, low[2]}, {low[0], high[1], kWindow.z0}, paint);
  solid(place, kRoom, {low[0] - far, 0, kWindow.z1}, {low[0], high[1], high[2]}, paint);
  solid(place, kRoom, {low[0] - far, 0, kWindow.z0}, {low[0], kWindow.y0, kWindow.z1}, paint);
  solid(place, kRoom, {low[0] - far, kWindow.y1, kWindow.z0}, {low[0], high[1], kWindow.z1}, paint);
}

}  // namespace l4d::io::synth
