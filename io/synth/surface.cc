// SPDX-License-Identifier: Apache-2.0
#include "io/synth/surface.h"

#include <algorithm>
#include <cmath>

namespace l4d::io::synth {
namespace {

constexpr double kSpread = 0.56;  // standard deviation of a Gaussian over the width of its cell

uint64_t mixed(uint64_t h, uint64_t key) {
  h = (h ^ key) * 0x9e3779b97f4a7c15U;
  h = (h ^ (h >> 31)) * 0xbf58476d1ce4e5b9U;
  return h ^ (h >> 29);
}

size_t ceil_count(double x, size_t least) {
  return std::max(least, static_cast<size_t>(std::ceil(x)));
}

}  // namespace

double length(const Vec3& v) { return std::sqrt(dot(v, v)); }

double power(double x, double exponent) { return x > 1e-300 ? exp(exponent * log(x)) : 0; }

Vec3 turn_y(const Vec3& v, double turns) {
  const double c = cos_turns(turns), s = sin_turns(turns);
  return {c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]};
}

void turn_over(Patch& patch) {
  for (Dot& d : patch) {
    d.u = d.u * -1;
    d.n = d.n * -1;
  }
}

std::vector<double> cell_borders(double length, double cell) {
  std::vector<double> out{0};
  const double rim = 0.35 * cell;
  if (length < 2.2 * cell) {
    const size_t n = ceil_count(length / cell - 0.2, 1);
    for (size_t k = 1; k <= n; ++k) out.push_back(length * static_cast<double>(k) / double(n));
    return out;
  }
  const size_t n = ceil_count((length - 2 * rim) / cell, 1);
  for (size_t k = 0; k <= n; ++k) {
    out.push_back(rim + (length - 2 * rim) * static_cast<double>(k) / static_cast<double>(n));
  }
  out.push_back(length);
  return out;
}

double Surfaces::random(uint64_t key, int64_t i, int64_t j, int64_t k) const {
  uint64_t h = mixed(seed + 0x51ed270b, key);
  h = mixed(h, static_cast<uint64_t>(i));
  h = mixed(h, static_cast<uint64_t>(j));
  h = mixed(h, static_cast<uint64_t>(k));
  return static_cast<double>(h >> 11) * 0x1p-53;
}

double Surfaces::random_at(uint64_t key, const Vec3& p) const {
  const auto whole = [](double x) { return static_cast<int64_t>(std::floor(x * 4096)); };
  return random(key, whole(p[0]), whole(p[1]), whole(p[2]));
}

double Surfaces::noise(const Vec3& p, double size, uint64_t key) const {
  int64_t cell[3];
  double f[3];
  for (size_t k = 0; k < 3; ++k) {
    const double q = p[k] / size;
    const double whole = std::floor(q);
    cell[k] = static_cast<int64_t>(whole);
    f[k] = (q - whole) * (q - whole) * (3 - 2 * (q - whole));
  }
  double sum = 0;
  for (int c = 0; c < 8; ++c) {
    const int x = c & 1, y = c >> 1 & 1, z = c >> 2;
    const double w = (x ? f[0] : 1 - f[0]) * (y ? f[1] : 1 - f[1]) * (z ? f[2] : 1 - f[2]);
    sum += w * random(key, cell[0] + x, cell[1] + y, cell[2] + z);
  }
  return sum;
}

Patch Surfaces::rectangle(const Vec3& o, const Vec3& eu, const Vec3& ev, double w, double h,
                          double cell, double jitter, const std::vector<Opening>& holes) const {
  cell *= density;
  const std::vector<double> la = cell_borders(w, cell), lb = cell_borders(h, cell);
  const double spread = jitter > 0.2 ? kSpread : 0.66;  // a regular grid shows gaps sooner
  const double along_a = w > 3 * h && h < 0.3 ? 0.85 : spread;
  const double along_b = h > 3 * w && w < 0.3 ? 0.85 : spread;
  Patch out;
  Dot d;
  d.u = unit(eu);
  d.v = unit(ev);
  d.n = cross(d.u, d.v);
  for (size_t i = 0; i + 1 < la.size(); ++i) {
    for (size_t j = 0; j + 1 < lb.size(); ++j) {
      const double wa = la[i + 1] - la[i], wb = lb[j + 1] - lb[j];
      double a = (la[i] + la[i + 1]) / 2, b = (lb[j] + lb[j + 1]) / 2;
      const Vec3 middle = o + d.u * a + d.v * b;
      a += jitter * wa * (random_at(1, middle) - 0.5);
      b += jitter * wb * (random_at(2, middle) - 0.5);
      if (wa > 0.5 * cell && j % 2 == 1) a += 0.5 * wa;  // as bricks lie: no lines of gaps
      const double low = la.size() < 4 ? 0.5 * wa : 0.35 * cell;
      a = std::min(std::max(a, low), std::max(w - 0.35 * cell, w / 2));
      const double m = 0.3 * cell;
      const bool open = std::any_of(holes.begin(), holes.end(), [&](const Opening& hole) {
        return a > hole.a0 + m && a < hole.a1 - m && b > hole.b0 + m && b < hole.b1 - m;
      });
      if (open) continue;
      d.p = o + d.u * a + d.v * b;
      d.su = wa * along_a;
      d.sv = wb * along_b;
      d.a = a;
      d.b = b;
      out.push_back(d);
    }
  }
  return out;
}

Patch Surfaces::box(const Vec3& low, const Vec3& high, double cell) const {
  const Vec3 size = high - low;
  const Vec3 x{1, 0, 0}, z{0, 0, 1};
  Patch out = rectangle({low[0], low[1], high[2]}, x, kUp, size[0], size[1], cell);
  append(out, rectangle({high[0], low[1], low[2]}, x * -1, kUp, size[0], size[1], cell));
  append(out, rectangle({high[0], low[1], high[2]}, z * -1, kUp, size[2], size[1], cell));
  append(out, rectangle(low, z, kUp, size[2], size[1], cell));
  append(out, rectangle({low[0], high[1], high[2]}, x, z * -1, size[0], size[2], cell));
  return out;
}

Patch Surfaces::ball(const Vec3& center, const Vec3& radii, double cell) const {
  cell *= density;
  const double rr = (radii[0] * radii[1] + radii[1] * radii[2] + radii[0] * radii[2]) / 3;
  const size_t n = std::max<size_t>(12, static_cast<size_t>(2 * kTurn * rr / (cell * cell)));
  Patch out(n);
  for (size_t i = 0; i < n; ++i) {
    const double k = static_cast<double>(i) + 0.5;
    const double y = 1 - 2 * k / static_cast<double>(n);
    const double turns = k * 0.6180339887498949;
    const Vec3 around = on_circle(turns, std::sqrt(1 - y * y));
    const Vec3 d{around[0], y, around[2]};
    Dot& dot = out[i];
    dot.p = center + d * radii;
    dot.n = unit({d[0] / radii[0], d[1] / radii[1], d[2] / radii[2]});
    dot.u = unit(cross({0, 1, 1e-3}, dot.n));
    dot.v = cross(dot.n, dot.u);
    dot.su = dot.sv = std::sqrt(2 * kTurn * rr / static_cast<double>(n)) * 0.63;
    dot.a = turns - std::floor(turns);
    dot.b = y;
  }
  return out;
}

Patch Surfaces::tube(const Vec3& p0, const Vec3& p1, double r0, double r1, double cell) const {
  cell *= density;
  const double long_ = length(p1 - p0);
  const Vec3 axis = (p1 - p0) * (1 / long_);
  const Vec3 e1 = unit(cross(axis, std::abs(axis[1]) > 0.5 ? Vec3{0.31, 0.17, 0.94} : kUp));
  const Vec3 e2 = cross(axis, e1);
  const std::vector<double> lb = cell_borders(long_, cell);
  Patch out;
  for (size_t k = 0; k + 1 < lb.size(); ++k) {
    const double b = (lb[k] + lb[k + 1]) / 2;
    double r = mix(r0, r1, b / long_);
    const size_t n = ceil_count(kTurn * r / cell, 6);
    r *= n == 6 ? 0.85 : 1;
    for (size_t i = 0; i < n; ++i) {
      const double turns =
          (static_cast<double>(i) + 0.5 * static_cast<double>(k & 1)) / static_cast<double>(n);
      const Vec3 around = e1 * cos_turns(turns) + e2 * sin_turns(turns);
      Dot d;
      d.u = e2 * cos_turns(turns) - e1 * sin_turns(turns);
      d.v = unit(axis + around * ((r1 - r0) / long_));
      d.n = cross(d.u, d.v);
      if (dot(d.n, around) < 0) {
        d.u = d.u * -1;
        d.n = d.n * -1;
      }
      d.p = p0 + axis * b + around * r;
      d.su = kTurn * r / static_cast<double>(n) * kSpread;
      d.sv = (lb[k + 1] - lb[k]) * kSpread;
      d.a = turns;
      d.b = b / long_;
      out.push_back(d);
    }
  }
  return out;
}

Patch Surfaces::disc(const Vec3& center, double r0, double r1, double cell, double rise) const {
  cell *= density;
  const std::vector<double> lb = cell_borders(r1 - r0, cell);
  const double slope = rise / (r1 - r0);
  Patch out;
  for (size_t k = 0; k + 1 < lb.size(); ++k) {
    const double r = r0 + (lb[k] + lb[k + 1]) / 2;
    const size_t n = ceil_count(kTurn * r / cell, 4);
    for (size_t i = 0; i < n; ++i) {
      const double turns =
          (static_cast<double>(i) + 0.5 * static_cast<double>(k & 1)) / static_cast<double>(n);
      Dot d;
      d.p = center + on_circle(turns, r) + kUp * (slope * (r - r0));
      d.u = on_circle(turns - 0.25, 1);
      d.v = unit(on_circle(turns, 1) * -1 - kUp * slope);
      d.n = cross(d.u, d.v);
      if (d.n[1] < 0) {
        d.u = d.u * -1;
        d.n = d.n * -1;
      }
      d.su = kTurn * r / static_cast<double>(n) * kSpread;
      d.sv = (lb[k + 1] - lb[k]) * kSpread * 1.05;
      d.a = turns;
      d.b = r;
      out.push_back(d);
    }
  }
  return out;
}

Dot Surfaces::leaf(const Vec3& p, const Vec3& toward, double size, uint64_t key, int64_t i) const {
  const auto side = [&](int64_t k) { return random(key, i, k) - 0.5; };
  Dot d;
  const Vec3 axis = unit(Vec3{side(1), side(2), side(3)} + toward * 0.5);
  d.p = p;
  d.u = unit(cross(axis, unit({side(4), side(5), side(6)})));
  d.v = cross(axis, d.u);
  d.n = axis;
  d.su = size * (0.65 + 0.7 * random(key, i, 7));
  d.sv = d.su * 0.6;
  d.kind = Kind::kLeaf;
  d.thin = 0.25;
  d.opacity = 0.9;
  return d;
}

}  // namespace l4d::io::synth
