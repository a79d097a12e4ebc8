// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

constexpr double kSlab = 0.5, kJoint = 0.035;
constexpr double kX0 = -13, kX1 = 13, kZ0 = -9, kZ1 = 12;

void slab(Place& place, int row, int column, double cx, double cz) {
  const double size = kSlab - kJoint;
  const Patch patch = place.rectangle({cx - size / 2, 0.002, cz + size / 2}, {1, 0, 0}, {0, 0, -1},
                                      size, size, 0.155, 0.25);
  const double from_fountain = length(Vec3{cx + 3.7, 0, cz + 1.2});
  const double ring = from_fountain - 2.2 * std::floor(from_fountain / 2.2);
  Vec3 tint = ring < 0.5 && from_fountain < 9 ? Vec3{0.36, 0.30, 0.26} : Vec3{0.30, 0.285, 0.28};
  tint = tint * (0.70 + 0.55 * place.random(7, row, column));
  if (place.random(10, row, column) < 0.12) tint = tint * 0.72;
  const double tip_x = 0.02 * (place.random(8, row, column) - 0.5);
  const double tip_z = 0.02 * (place.random(9, row, column) - 0.5);
  place.put(patch, [&](Dot& d) {
    d.p[1] += tip_x * (d.p[0] - cx) + tip_z * (d.p[2] - cz);
    d.albedo = tint * (0.82 + 0.72 * place.noise(d.p, 0.16, 11) * place.noise(d.p, 1.9, 12));
    d.gloss = 0.75 * (0.5 + 0.9 * place.noise(d.p, 1.7, 13));
    d.su *= 1.07;
    d.sv *= 1.07;
    d.thin = 0.05;
  });
}

// Thin long Gaussians: a dark sheet below the slabs would shine through at grazing angles.
void joint(Place& place, const Vec3& middle, const Vec3& along, double sigma) {
  Dot d;
  d.p = middle;
  d.u = along;
  d.v = cross(kUp, along);
  d.n = kUp;
  d.su = sigma;
  d.sv = 0.015;
  place.put({d}, [](Dot& j) {
    j.albedo = {0.12, 0.112, 0.11};
    j.gloss = 0.4;
  });
}

}  // namespace

void make_ground(Place& place) {
  const int rows = static_cast<int>((kZ1 - kZ0) / kSlab);
  const int columns = static_cast<int>((kX1 - kX0) / kSlab) + 1;
  // Fewer, longer Gaussians along joints where all is coarse.
  const int across = place.density > 1.6 ? 1 : (place.density > 0.8 ? 3 : 6);
  const double step = 0.17 * std::max(place.density, 0.3);
  for (int row = 0; row < rows; ++row) {
    const double cz = kZ0 + (row + 0.5) * kSlab;
    for (double x = kX0; x < kX1; x += step) {
      joint(place, {x, -0.012, kZ0 + row * kSlab}, {1, 0, 0}, 0.65 * step);
    }
    for (int column = 0; column < columns; ++column) {
      const double cx = kX0 + (column + 0.5 * (row & 1)) * kSlab;
      slab(place, row, column, cx, cz);
      for (int k = 0; k < across; ++k) {
        const double z = cz + kSlab * ((k + 0.5) / across - 0.5);
        joint(place, {cx + kSlab / 2, -0.012, z}, {0, 0, 1}, 0.33 / across);
      }
    }
  }
  const Patch below = place.rectangle({kX0 - 1, -0.2, kZ1 + 1}, {1, 0, 0}, {0, 0, -1},
                                      kX1 - kX0 + 2, kZ1 - kZ0 + 2, 0.42);
  place.put(below, [](Dot& d) {
    d.emit = {0.030, 0.029, 0.034};
    d.kind = Kind::kUnshaded;
  });
}

}  // namespace l4d::io::synth
