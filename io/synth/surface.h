// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "io/synth/synth_math.h"

// Surfaces of a place as Gaussians that lie flat on them. Numbers that look random are hashes of
// the seed and of where or which a thing is, so nothing depends on what was made before.
namespace l4d::io::synth {

inline Vec3 operator+(const Vec3& a, const Vec3& b) { return add(a, b); }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return add(a, times(b, -1)); }
inline Vec3 operator*(const Vec3& a, double s) { return times(a, s); }
inline Vec3 operator*(const Vec3& a, const Vec3& b) {
  return {a[0] * b[0], a[1] * b[1], a[2] * b[2]};
}
inline double mix(double a, double b, double t) { return a + (b - a) * t; }
inline Vec3 mix(const Vec3& a, const Vec3& b, double t) { return a + (b - a) * t; }
inline double clamp(double x, double low, double high) {
  return x < low ? low : (x > high ? high : x);
}
inline double smooth(double low, double high, double x) {  // 0 at low, 1 at high
  const double t = clamp((x - low) / (high - low), 0, 1);
  return t * t * (3 - 2 * t);
}
double length(const Vec3& v);
double power(double x, double exponent);         // 0 where x <= 0
Vec3 turn_y(const Vec3& v, double turns);        // about the vertical
inline Vec3 on_circle(double turns, double r) {  // in the horizontal plane
  return {r * cos_turns(turns), 0, r * sin_turns(turns)};
}
constexpr Vec3 kUp{0, 1, 0};
constexpr double kTurn = 6.283185307179586;

enum class Kind : uint8_t { kShaded, kUnshaded, kLeaf, kChrome };

// One Gaussian. Tangents u and v are orthogonal unit vectors; u x v is its third axis.
struct Dot {
  Vec3 p{}, u{1, 0, 0}, v{0, 1, 0};
  double su = 0, sv = 0;  // standard deviations along u and v
  double a = 0, b = 0;    // where on its surface, for textures
  Vec3 n{};               // for light: u x v, unless a surface says otherwise
  Vec3 albedo{}, emit{};  // linear
  double thin = 0.06;     // standard deviation along u x v, of the smaller one of su and sv
  double opacity = 0.96;
  double gloss = 0;
  Vec3 velocity{};     // a second
  double t = 0;        // mean time, seconds
  double sigma_t = 0;  // 0: it stands still all the time
  uint32_t window[2] = {0, 0};
  Kind kind = Kind::kShaded;
};
using Patch = std::vector<Dot>;

struct Opening {  // of a rectangle
  double a0, b0, a1, b1;
};

// Makes patches: a cell of `cell` metres per Gaussian, times `density`.
struct Surfaces {
  uint64_t seed = 1;
  double density = 1;

  double random(uint64_t key, int64_t i = 0, int64_t j = 0, int64_t k = 0) const;  // [0, 1)
  double random_at(uint64_t key, const Vec3& p) const;  // of a place, to a quarter of a millimetre
  double noise(const Vec3& p, double size, uint64_t key) const;  // 0..1, smooth

  // From corner `o` along the unit vectors eu and ev. a, b: metres along them.
  Patch rectangle(const Vec3& o, const Vec3& eu, const Vec3& ev, double w, double h, double cell,
                  double jitter = 0.3, const std::vector<Opening>& holes = {}) const;
  Patch box(const Vec3& low, const Vec3& high, double cell) const;  // without its bottom
  // a: turns around, b: height from -1 to 1.
  Patch ball(const Vec3& center, const Vec3& radii, double cell) const;
  // A truncated cone without lids, its normals outwards. a: turns around, b: 0..1 along.
  Patch tube(const Vec3& p0, const Vec3& p1, double r0, double r1, double cell) const;
  // A ring in the horizontal plane, seen from above; its rim lies `rise` higher. a: turns, b:
  // radius.
  Patch disc(const Vec3& center, double r0, double r1, double cell, double rise = 0) const;
  // A small flat ellipse, turned at random with its normal near `toward`.
  Dot leaf(const Vec3& p, const Vec3& toward, double size, uint64_t key, int64_t i) const;
};

// Borders of the cells along an edge: the outermost ones are narrow, so silhouettes are sharp.
std::vector<double> cell_borders(double length, double cell);
void turn_over(Patch& patch);
inline Patch& append(Patch& to, const Patch& more) {
  to.insert(to.end(), more.begin(), more.end());
  return to;
}
template <typename Keep>
Patch kept(const Patch& patch, const Keep& keep) {
  Patch out;
  for (const Dot& d : patch) {
    if (keep(d)) out.push_back(d);
  }
  return out;
}

}  // namespace l4d::io::synth
