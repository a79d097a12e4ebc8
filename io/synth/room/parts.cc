// SPDX-License-Identifier: Apache-2.0
#include "io/synth/room/parts.h"

#include <algorithm>

namespace l4d::io::synth {

Patch slab(const Surfaces& make, const Vec3& o, const Vec3& eu, const Vec3& ev, double w, double h,
           double cell, double jitter) {
  Patch out = make.rectangle(o, eu, ev, w, h, cell, jitter);
  for (Dot& d : out) {
    d.su = std::min(d.su, 0.4 * w);
    d.sv = std::min(d.sv, 0.4 * h);
  }
  return out;
}

Patch threads(const Surfaces& make, const Vec3& o, const Vec3& eu, const Vec3& ev, double w,
              double h, double cell, double longer) {
  Patch out = make.rectangle(o, eu, ev, w, h / longer, cell, 0.1);
  for (Dot& d : out) {
    d.p = d.p + d.v * (dot(d.p - o, d.v) * (longer - 1));
    d.b *= longer;
    d.sv *= longer;
  }
  return out;
}

Patch crate(const Surfaces& make, const Vec3& low, const Vec3& high, double cell) {
  const Vec3 size = high - low;
  const auto face = [&](const Vec3& o, const Vec3& eu, const Vec3& ev, double w, double h) {
    return slab(make, o, eu, ev, w, h, cell, 0.15);
  };
  Patch out = face({low[0], low[1], high[2]}, kRight, kUp, size[0], size[1]);
  append(out, face({high[0], low[1], low[2]}, kRight * -1, kUp, size[0], size[1]));
  append(out, face({high[0], low[1], high[2]}, kFront * -1, kUp, size[2], size[1]));
  append(out, face(low, kFront, kUp, size[2], size[1]));
  append(out, face({low[0], high[1], high[2]}, kRight, kFront * -1, size[0], size[2]));
  return append(out, face(low, kRight, kFront, size[0], size[2]));
}

void solid(Place& place, const Stand& stand, const Vec3& low, const Vec3& high, const Vec3& color) {
  if (place.counting) return;
  Occluder o{stand((low + high) * 0.5), length(high - low) / 2, {}, color, 0};
  for (size_t k = 0; k < 3; ++k) {
    Vec3 axis{};
    axis[k] = 1;
    const Vec3 n = stand.way(axis);
    o.planes.push_back({n, dot(n, stand(high))});
    o.planes.push_back({n * -1, 0.0 - dot(n, stand(low))});
  }
  place.light.occluders.push_back(o);
}

Vec3 wood(const Surfaces& make, const Vec3& p, const Vec3& color, size_t grain, uint64_t key) {
  Vec3 squeezed = p;
  squeezed[grain] *= 0.12;
  const double fine = make.noise(squeezed, 0.022, key), broad = make.noise(squeezed, 0.09, key + 1);
  return color * (0.62 + 0.34 * fine + 0.42 * broad);
}

void put_wood(Place& place, const Patch& patch, const Vec3& color, size_t grain, uint64_t key,
              double gloss) {
  place.put(patch, [&](Dot& d) {
    d.albedo = wood(place, d.p, color, grain, key);
    d.gloss = gloss;
  });
}

void plank(Place& place, const Stand& stand, const Vec3& low, const Vec3& high, double cell,
           const Vec3& color, size_t grain, uint64_t key, double gloss) {
  put_wood(place, stand(crate(place, low, high, cell)), color, grain, key, gloss);
  solid(place, stand, low, high, color * 0.8);
}

Patch turned(const Surfaces& make, const Vec3& foot,
             const std::vector<std::array<double, 2>>& rings, double cell) {
  Patch out;
  for (size_t k = 0; k + 1 < rings.size(); ++k) {
    append(out, make.tube(foot + kUp * rings[k][1], foot + kUp * rings[k + 1][1], rings[k][0],
                          rings[k + 1][0], cell));
  }
  return out;
}

Patch with_thickness(Patch patch, double thin) {
  for (Dot& d : patch) d.thin = thin;
  return patch;
}

}  // namespace l4d::io::synth
