// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "io/scene/rotor_math.h"

// Random numbers and elementary functions with specified bits: integers, + - * / sqrt and floor
// only, so a synthetic scene is the same on every machine. The standard library's distributions and
// transcendental functions differ between implementations.
namespace l4d::io::synth {

// SplitMix64. One generator per item, seeded by what the item is, so that no item depends on how
// many others were made before it.
class Rng {
 public:
  Rng(uint64_t seed, uint64_t stream, uint64_t index);

  uint64_t bits() {
    state_ += 0x9e3779b97f4a7c15U;
    uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31);
  }
  double uniform() { return static_cast<double>(bits() >> 11) * 0x1p-53; }  // [0, 1)
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  // Nearly normal, mean 0, variance 1, within +-3.5: the sum of four uniform numbers.
  double normal() {
    const uint64_t b = bits();
    const uint64_t sum = (b & 0xffff) + ((b >> 16) & 0xffff) + ((b >> 32) & 0xffff) + (b >> 48);
    constexpr double kSqrt3 = 1.7320508075688772;
    return (static_cast<double>(sum) - 131070.0) * (kSqrt3 / 65536);
  }
  Vec3 direction();            // on the unit sphere
  Vec4 turn_about(Vec3 axis);  // unit quaternion, random angle; `axis` of length 1

 private:
  uint64_t state_;
};

double exp(double x);            // |x| < 700
double log(double x);            // x > 0, normal
double sin_turns(double turns);  // sin(2 pi turns)
inline double cos_turns(double turns) { return sin_turns(turns + 0.25); }

inline Vec3 add(const Vec3& a, const Vec3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
inline Vec3 times(const Vec3& a, double s) { return {a[0] * s, a[1] * s, a[2] * s}; }
Vec3 unit(const Vec3& v);  // x axis where v is zero

Vec4 multiply(const Vec4& a, const Vec4& b);  // quaternions w x y z
Vec4 turn_z_to(const Vec3& direction);        // unit quaternion taking the z axis to a unit vector

}  // namespace l4d::io::synth
