// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

// Independent formulas in long double, written from the definitions and not from the library: what
// the library's closed forms are measured against.
namespace l4d::reference {

using Real = long double;

struct Rotor {
  Real s, b01, b02, b12, b03, b13, b23, p;
};

template <typename T>
Rotor load(const T* r) {
  return {Real(r[0]), Real(r[1]), Real(r[2]), Real(r[3]),
          Real(r[4]), Real(r[5]), Real(r[6]), Real(r[7])};
}

// Textbook normalisation: move along the gradient of the constraint, then divide by the 8-norm. The
// textbook's quotient (root - l2) / (2 eps) is written without its cancellation.
inline Rotor normalize(const Rotor& r) {
  const Real l2 = r.s * r.s + r.b01 * r.b01 + r.b02 * r.b02 + r.b12 * r.b12 + r.b03 * r.b03 +
                  r.b13 * r.b13 + r.b23 * r.b23 + r.p * r.p;
  const Real eps = r.s * r.p - r.b01 * r.b23 + r.b02 * r.b13 - r.b03 * r.b12;
  const Real delta = -2 * eps / (l2 + std::sqrt(l2 * l2 - 4 * eps * eps));
  Rotor o{r.s + delta * r.p,     r.b01 - delta * r.b23, r.b02 + delta * r.b13,
          r.b12 - delta * r.b03, r.b03 - delta * r.b12, r.b13 + delta * r.b02,
          r.b23 - delta * r.b01, r.p + delta * r.s};
  const Real norm = std::sqrt(o.s * o.s + o.b01 * o.b01 + o.b02 * o.b02 + o.b12 * o.b12 +
                              o.b03 * o.b03 + o.b13 * o.b13 + o.b23 * o.b23 + o.p * o.p);
  for (Real* c : {&o.s, &o.b01, &o.b02, &o.b12, &o.b03, &o.b13, &o.b23, &o.p}) *c /= norm;
  return o;
}

// The quadratic polynomials of the rotation matrix, row = world axis x, y, z, t.
inline void matrix(const Rotor& q, Real (*m)[4]) {
  const Real s = q.s, b01 = q.b01, b02 = q.b02, b12 = q.b12;
  const Real b03 = q.b03, b13 = q.b13, b23 = q.b23, p = q.p;
  m[0][0] = s * s + b12 * b12 + b13 * b13 + b23 * b23 - b01 * b01 - b02 * b02 - b03 * b03 - p * p;
  m[1][1] = s * s + b02 * b02 + b03 * b03 + b23 * b23 - b01 * b01 - b12 * b12 - b13 * b13 - p * p;
  m[2][2] = s * s + b01 * b01 + b03 * b03 + b13 * b13 - b02 * b02 - b12 * b12 - b23 * b23 - p * p;
  m[3][3] = s * s + b01 * b01 + b02 * b02 + b12 * b12 - b03 * b03 - b13 * b13 - b23 * b23 - p * p;
  m[0][1] = 2 * (s * b01 - b02 * b12 - b03 * b13 + b23 * p);
  m[1][0] = -2 * (s * b01 + b02 * b12 + b03 * b13 + b23 * p);
  m[0][2] = 2 * (s * b02 + b01 * b12 - b03 * b23 - b13 * p);
  m[2][0] = 2 * (-s * b02 + b01 * b12 - b03 * b23 + b13 * p);
  m[0][3] = 2 * (s * b03 + b01 * b13 + b02 * b23 + b12 * p);
  m[3][0] = 2 * (-s * b03 + b01 * b13 + b02 * b23 - b12 * p);
  m[1][2] = 2 * (s * b12 - b01 * b02 - b13 * b23 + b03 * p);
  m[2][1] = -2 * (s * b12 + b01 * b02 + b13 * b23 + b03 * p);
  m[1][3] = 2 * (s * b13 - b01 * b03 + b12 * b23 - b02 * p);
  m[3][1] = 2 * (-s * b13 - b01 * b03 + b12 * b23 + b02 * p);
  m[2][3] = 2 * (s * b23 - b02 * b03 - b12 * b13 + b01 * p);
  m[3][2] = -2 * (s * b23 + b02 * b03 + b12 * b13 + b01 * p);
}

// Covariance in space-time, R diag(exp(2 log_scale)) R^T.
template <typename T>
void covariance4(const T* rotor, const T* log_scale, Real (*sigma)[4]) {
  Real m[4][4];
  matrix(normalize(load(rotor)), m);
  Real s2[4];
  for (int k = 0; k < 4; ++k) s2[k] = std::exp(2 * Real(log_scale[k]));
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      sigma[i][j] = 0;
      for (int k = 0; k < 4; ++k) sigma[i][j] += m[i][k] * s2[k] * m[j][k];
    }
  }
}

// Textbook slice in arithmetic U: form the covariance, then take the Schur complement.
template <typename U>
void schur(const U* rows, U* velocity, U* lambda, U* covariance) {
  U sigma[4][4];
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      sigma[i][j] = 0;
      for (int k = 0; k < 4; ++k) sigma[i][j] += rows[4 * i + k] * rows[4 * j + k];
    }
  }
  *lambda = U(1) / sigma[3][3];
  int out = 0;
  for (int i = 0; i < 3; ++i) {
    velocity[i] = sigma[i][3] / sigma[3][3];
    for (int j = i; j < 3; ++j) {
      covariance[out++] = sigma[i][j] - sigma[i][3] * sigma[j][3] / sigma[3][3];
    }
  }
}

// The same covariance by Cauchy-Binet, a sum of products of 2x2 minors: no cancellation at all
// between terms of the sum.
inline void minors(const Real* rows, Real* covariance) {
  const Real* t = rows + 12;
  const Real tt = t[0] * t[0] + t[1] * t[1] + t[2] * t[2] + t[3] * t[3];
  Real p[3][6];
  for (int i = 0; i < 3; ++i) {
    const Real* m = rows + 4 * i;
    int n = 0;
    for (int a = 0; a < 4; ++a) {
      for (int b = a + 1; b < 4; ++b) p[i][n++] = m[a] * t[b] - m[b] * t[a];
    }
  }
  int out = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      Real sum = 0;
      for (int n = 0; n < 6; ++n) sum += p[i][n] * p[j][n];
      covariance[out++] = sum / tt;
    }
  }
}

// By leading minors, in long double, of a covariance xx xy xz yy yz zz.
template <typename T>
bool positive_definite(const T* c) {
  const Real xx = c[0], xy = c[1], xz = c[2], yy = c[3], yz = c[4], zz = c[5];
  const Real d2 = xx * yy - xy * xy;
  const Real d3 = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
  return xx > 0 && d2 > 0 && d3 > 0;
}

// |a - b| / |b| in the Frobenius norm of the symmetric 3x3 matrices.
template <typename T>
double relative_error6(const T* a, const Real* b) {
  static constexpr int kCount[6] = {1, 2, 2, 1, 2, 1};
  Real difference = 0, norm = 0;
  for (int i = 0; i < 6; ++i) {
    difference += kCount[i] * (Real(a[i]) - b[i]) * (Real(a[i]) - b[i]);
    norm += kCount[i] * b[i] * b[i];
  }
  return static_cast<double>(std::sqrt(difference / norm));
}

inline double relative_error4(const Real (*a)[4], const Real (*b)[4]) {
  Real difference = 0, norm = 0;
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      difference += (a[i][j] - b[i][j]) * (a[i][j] - b[i][j]);
      norm += b[i][j] * b[i][j];
    }
  }
  return static_cast<double>(std::sqrt(difference / norm));
}

// Random numbers that do not depend on the standard library's distributions.
class Random {
 public:
  explicit Random(uint64_t seed) : engine_(seed) {}
  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }  // [0, 1)
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  double log_uniform(double low, double high) {
    return std::exp(uniform(std::log(low), std::log(high)));
  }
  double normal() {
    return std::sqrt(-2.0 * std::log(1.0 - uniform())) * std::cos(6.283185307179586 * uniform());
  }
  uint64_t below(uint64_t n) { return engine_() % n; }

 private:
  std::mt19937_64 engine_;
};

// Random orientation in space whose temporal part has coefficients of about `temporal`.
template <typename T>
void random_rotor(Random& random, double temporal, T* rotor) {
  double r[8], norm = 0;
  for (double& c : r) c = random.normal();
  for (int i = 0; i < 4; ++i) norm += r[i] * r[i];
  for (int i = 0; i < 4; ++i) rotor[i] = static_cast<T>(r[i] / std::sqrt(norm));
  for (int i = 4; i < 8; ++i) rotor[i] = static_cast<T>(r[i] * temporal);
}

inline double quantile(std::vector<double> values, double q) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * double(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace l4d::reference
