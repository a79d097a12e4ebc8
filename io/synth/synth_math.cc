// SPDX-License-Identifier: Apache-2.0
#include "io/synth/synth_math.h"

#include <cmath>
#include <cstring>

namespace l4d::io::synth {

Rng::Rng(uint64_t seed, uint64_t stream, uint64_t index) : state_(seed) {
  state_ = bits() ^ stream;
  state_ = bits() ^ index;
  state_ = bits();
}

Vec3 Rng::direction() {
  for (;;) {
    const Vec3 v{uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)};
    const double norm2 = dot(v, v);
    if (norm2 <= 1 && norm2 >= 1e-4) return times(v, 1 / std::sqrt(norm2));
  }
}

Vec4 Rng::turn_about(Vec3 axis) {
  for (;;) {
    const double c = uniform(0, 1), s = uniform(-1, 1);  // of half the angle
    const double norm2 = c * c + s * s;
    if (norm2 > 1 || norm2 < 1e-4) continue;
    const double r = 1 / std::sqrt(norm2);
    return {c * r, s * r * axis[0], s * r * axis[1], s * r * axis[2]};
  }
}

double exp(double x) {
  // x = k ln 2 + r with |r| <= ln 2 / 2; ln 2 in two parts so that k ln 2 is exact enough.
  constexpr double kInverseFactorial[15] = {1.0,
                                            1.0,
                                            1.0 / 2,
                                            1.0 / 6,
                                            1.0 / 24,
                                            1.0 / 120,
                                            1.0 / 720,
                                            1.0 / 5040,
                                            1.0 / 40320,
                                            1.0 / 362880,
                                            1.0 / 3628800,
                                            1.0 / 39916800,
                                            1.0 / 479001600,
                                            1.0 / 6227020800,
                                            1.0 / 87178291200};
  const double k = std::floor(x * 1.4426950408889634 + 0.5);
  const double r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10;
  double sum = kInverseFactorial[14];
  for (int n = 13; n >= 0; --n) sum = sum * r + kInverseFactorial[n];
  const uint64_t power_bits = static_cast<uint64_t>(static_cast<int64_t>(k) + 1023) << 52;
  double power = 0;  // 2^k
  std::memcpy(&power, &power_bits, sizeof(power));
  return sum * power;
}

double log(double x) {
  int exponent = 0;
  double m = std::frexp(x, &exponent);  // [0.5, 1)
  if (m < 0.70710678118654757) {
    m *= 2;
    --exponent;
  }
  // log m = 2 artanh((m - 1) / (m + 1)), an odd series of |z| < 0.172
  constexpr double kInverseOdd[12] = {1.0,      1.0 / 3,  1.0 / 5,  1.0 / 7,  1.0 / 9,  1.0 / 11,
                                      1.0 / 13, 1.0 / 15, 1.0 / 17, 1.0 / 19, 1.0 / 21, 1.0 / 23};
  const double z = (m - 1) / (m + 1);
  const double zz = z * z;
  double sum = kInverseOdd[11];
  for (int n = 10; n >= 0; --n) sum = sum * zz + kInverseOdd[n];
  return exponent * 0.69314718055994531 + 2 * z * sum;
}

double sin_turns(double turns) {
  double r = turns - std::floor(turns + 0.5);  // [-0.5, 0.5)
  if (r > 0.25) r = 0.5 - r;
  if (r < -0.25) r = -0.5 - r;
  const double x = r * 6.283185307179586;
  constexpr double kSeries[11] = {1.0,
                                  -1.0 / 6,
                                  1.0 / 120,
                                  -1.0 / 5040,
                                  1.0 / 362880,
                                  -1.0 / 39916800,
                                  1.0 / 6227020800,
                                  -1.0 / 1307674368000,
                                  1.0 / 355687428096000,
                                  -1.0 / 121645100408832000,
                                  1.0 / 51090942171709440000.0};
  const double xx = x * x;
  double sum = kSeries[10];
  for (int n = 9; n >= 0; --n) sum = sum * xx + kSeries[n];
  return x * sum;
}

Vec3 unit(const Vec3& v) {
  const double norm2 = dot(v, v);
  return norm2 > 0 ? times(v, 1 / std::sqrt(norm2)) : Vec3{1, 0, 0};
}

Vec4 multiply(const Vec4& a, const Vec4& b) {
  return {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
          a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
          a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
          a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
}

Vec4 turn_z_to(const Vec3& d) {
  // Half-way quaternion; the opposite direction has no unique one.
  const double w = 1 + d[2];
  if (w < 1e-9) return {0, 1, 0, 0};
  const double norm = std::sqrt(w * w + d[0] * d[0] + d[1] * d[1]);
  return {w / norm, (0.0 - d[1]) / norm, d[0] / norm, 0};
}

}  // namespace l4d::io::synth
