// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/room/parts.h"

namespace l4d::io::synth {

void make_rug(Place& place) {
  constexpr double kW = kRugX1 - kRugX0, kD = kRugZ1 - kRugZ0;
  constexpr Vec3 kRed{0.36, 0.055, 0.042}, kBlue{0.045, 0.075, 0.16}, kCream{0.56, 0.45, 0.28},
      kGold{0.50, 0.28, 0.07};
  const auto pattern = [&](const Dot& d) {
    const double rim = std::min(std::min(d.a, kW - d.a), std::min(d.b, kD - d.b));
    if (rim < 0.05) return kBlue;
    if (rim < 0.08) return kCream;
    if (rim < 0.30) {  // a border of blossoms
      const bool side = std::min(d.a, kW - d.a) < std::min(d.b, kD - d.b);
      const double run = (side ? d.b : d.a) / 0.22;
      const double q = run - std::floor(run) - 0.5, r = (rim - 0.19) / 0.22;
      const double far = std::sqrt(q * q + r * r);
      return far < 0.14 ? kCream : (far < 0.30 ? kRed : kBlue);
    }
    if (rim < 0.34) return kGold;
    // The field: a medallion with petals, and corners like it.
    const auto rosette = [&](double x, double y, double size) {
      const double r = std::sqrt(x * x + y * y) / size;
      const double c = x / (r * size + 1e-9), s = y / (r * size + 1e-9);
      const double c2 = c * c - s * s, s2 = 2 * c * s, c4 = c2 * c2 - s2 * s2, c8 = 2 * c4 * c4 - 1;
      return r / (1 + 0.16 * c8);
    };
    const double far = rosette(d.a - kW / 2, (d.b - kD / 2) * 1.25, 0.62);
    if (far < 0.16) return kRed;
    if (far < 0.34) return kCream;
    if (far < 0.42) return kGold;
    if (far < 0.85) return kBlue;
    if (far < 1.0) return kCream;
    const double ca = d.a < kW / 2 ? d.a - 0.34 : kW - 0.34 - d.a;
    const double cb = d.b < kD / 2 ? d.b - 0.34 : kD - 0.34 - d.b;
    const double corner = rosette(ca, cb, 0.46);
    if (corner < 0.5) return kGold;
    if (corner < 0.88) return kBlue;
    if (corner < 1.0) return kCream;
    const double u = d.a / 0.2, v = d.b / 0.2;  // small flowers on red
    const double x = u - std::floor(u) - 0.5, y = v - std::floor(v) - 0.5;
    const bool flower = (static_cast<int>(u) + static_cast<int>(v)) % 2 == 0;
    return flower && x * x + y * y < 0.05 ? kGold : kRed;
  };
  place.put(place.rectangle({kRugX0, 0.012, kRugZ1}, kRight, {0, 0, -1}, kW, kD, 0.026, 0.15),
            [&](Dot& d) {
              d.albedo = pattern(d) * (0.72 + 0.5 * place.random_at(341, d.p));
              d.thin = 0.05;
            });
  place.put(place.rectangle({kRugX0, -0.02, kRugZ1}, kRight, {0, 0, -1}, kW, kD, 0.12), kRed * 0.5);
  // Fringes: threads along x at both short ends.
  const int threads = static_cast<int>(kD / (0.03 * std::max(0.7, place.density)));
  for (int k = 0; k < threads; ++k) {
    for (const double x : {kRugX0 - 0.03, kRugX1 + 0.03}) {
      Dot d;
      d.p = {x, 0.008, kRugZ0 + kD * (k + 0.5) / threads};
      d.u = unit({1, 0, 0.5 * (place.random(342, k) - 0.5)});
      d.v = cross(kUp, d.u);
      d.n = kUp;
      d.su = 0.028;
      d.sv = 0.24 * kD / threads;
      d.thin = 0.3;
      place.put({d}, kCream * (0.8 + 0.4 * place.random(343, k)));
    }
  }
}

}  // namespace l4d::io::synth
