// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "libl4dcodec/math/hd.h"

namespace l4d {

// Order of the eight coefficients of a 4D rotor. Axes 0..3 are x, y, z, t; the first four describe
// the rotation of space, the last four its mixing with time.
enum RotorIndex {
  kRotorS = 0,
  kRotorB01,
  kRotorB02,
  kRotorB12,
  kRotorB03,
  kRotorB13,
  kRotorB23,
  kRotorP
};

// A 4D rotation is a pair of unit quaternions. Any eight numbers split into two halves; the rotor
// is valid exactly when both have length 1, so normalising is two ordinary quaternion
// normalisations. The textbook's correction of the constraint s p - b01 b23 + b02 b13 - b03 b12 = 0
// is the same map, but divides by the violation, which is nearly zero for every good rotor.
template <typename T>
struct RotorHalves {
  T a[4];
  T b[4];
};

// Below this squared length a half has no direction left to keep.
constexpr float kMinHalfNorm2 = 1e-12f;

template <typename T>
L4D_HOST_DEVICE inline RotorHalves<T> halves_of_rotor(const T* rotor /* [8] */) {
  RotorHalves<T> h;
  h.a[0] = rotor[kRotorS] + rotor[kRotorP];
  h.a[1] = rotor[kRotorB01] - rotor[kRotorB23];
  h.a[2] = rotor[kRotorB02] + rotor[kRotorB13];
  h.a[3] = rotor[kRotorB12] - rotor[kRotorB03];
  h.b[0] = rotor[kRotorS] - rotor[kRotorP];
  h.b[1] = rotor[kRotorB01] + rotor[kRotorB23];
  h.b[2] = rotor[kRotorB02] - rotor[kRotorB13];
  h.b[3] = rotor[kRotorB12] + rotor[kRotorB03];
  return h;
}

template <typename T>
L4D_HOST_DEVICE inline void rotor_of_halves(const RotorHalves<T>& h, T* rotor /* [8] */) {
  const T half = static_cast<T>(0.5);
  rotor[kRotorS] = (h.a[0] + h.b[0]) * half;
  rotor[kRotorB01] = (h.a[1] + h.b[1]) * half;
  rotor[kRotorB02] = (h.a[2] + h.b[2]) * half;
  rotor[kRotorB12] = (h.a[3] + h.b[3]) * half;
  rotor[kRotorB03] = (h.b[3] - h.a[3]) * half;
  rotor[kRotorB13] = (h.a[2] - h.b[2]) * half;
  rotor[kRotorB23] = (h.b[1] - h.a[1]) * half;
  rotor[kRotorP] = (h.a[0] - h.b[0]) * half;
}

template <typename T>
L4D_HOST_DEVICE inline void normalize_half(T* half /* [4] */) {
  const T norm2 = (half[0] * half[0] + half[1] * half[1]) + (half[2] * half[2] + half[3] * half[3]);
  if (norm2 < static_cast<T>(kMinHalfNorm2)) {
    half[0] = static_cast<T>(1);
    half[1] = half[2] = half[3] = static_cast<T>(0);
    return;
  }
  // Divisions, not a product with 1/r: one rounding less, and no reciprocal a target could
  // approximate.
  const T r = square_root(norm2);
  half[0] = half[0] / r;
  half[1] = half[1] / r;
  half[2] = half[2] / r;
  half[3] = half[3] / r;
}

// A coded stereographic coordinate as a multiple of 2^-24: so no quotient of them is subnormal
// (spec: appendix C).
L4D_HOST_DEVICE inline float on_stereographic_grid(float w) { return (w + 1.5f) - 1.5f; }

// A unit quaternion from its stereographic coordinates u = (q1, q2, q3) / (1 + q0): every u gives
// one, and every quaternion but (-1, 0, 0, 0) has one.
template <typename T>
L4D_HOST_DEVICE inline void half_of_stereographic(const T* u /* [3] */, T* half /* [4] */) {
  const T one = static_cast<T>(1);
  const T norm2 = (u[0] * u[0] + u[1] * u[1]) + u[2] * u[2];
  const T r = (one + one) / (one + norm2);
  half[0] = r - one;
  half[1] = u[0] * r;
  half[2] = u[1] * r;
  half[3] = u[2] * r;
}

template <typename T>
L4D_HOST_DEVICE inline void stereographic_of_half(const T* half /* [4] */, T* u /* [3] */) {
  const T d = static_cast<T>(1) + half[0];
  u[0] = half[1] / d;
  u[1] = half[2] / d;
  u[2] = half[3] / d;
}

template <typename T>
L4D_HOST_DEVICE inline RotorHalves<T> normalized_halves(const T* rotor /* [8] */) {
  RotorHalves<T> h = halves_of_rotor(rotor);
  normalize_half(h.a);
  normalize_half(h.b);
  return h;
}

// The nearest valid rotor. For float the order of these operations is part of the bitstream
// specification: compile without contraction (-ffp-contract=off, --fmad=false). `out` may be `in`.
template <typename T>
L4D_HOST_DEVICE inline void normalize_rotor(const T* in /* [8] */, T* out /* [8] */) {
  rotor_of_halves(normalized_halves(in), out);
}

// The rotation matrix [4, 4], row = world axis, column = local axis. Each entry is a signed sum of
// four products a[i] b[j]; with unit halves the result is orthogonal up to rounding, with no
// constraint left to violate.
template <typename T>
L4D_HOST_DEVICE inline void rotor_to_matrix(const RotorHalves<T>& h, T* matrix /* [4, 4] */) {
  const T* a = h.a;
  const T* b = h.b;
  const T p00 = a[0] * b[0], p11 = a[1] * b[1], p22 = a[2] * b[2], p33 = a[3] * b[3];
  const T p01 = a[0] * b[1], p10 = a[1] * b[0], p23 = a[2] * b[3], p32 = a[3] * b[2];
  const T p02 = a[0] * b[2], p20 = a[2] * b[0], p13 = a[1] * b[3], p31 = a[3] * b[1];
  const T p03 = a[0] * b[3], p30 = a[3] * b[0], p12 = a[1] * b[2], p21 = a[2] * b[1];

  matrix[0] = (p00 - p11) - (p22 - p33);
  matrix[1] = (p01 + p10) - (p23 + p32);
  matrix[2] = (p02 + p20) + (p13 + p31);
  matrix[3] = (p03 - p30) - (p12 - p21);

  matrix[4] = -((p01 + p10) + (p23 + p32));
  matrix[5] = (p00 - p11) + (p22 - p33);
  matrix[6] = (p03 + p30) - (p12 + p21);
  matrix[7] = -((p02 - p20) + (p13 - p31));

  matrix[8] = (p13 + p31) - (p02 + p20);
  matrix[9] = -((p03 + p30) + (p12 + p21));
  matrix[10] = (p00 + p11) - (p22 + p33);
  matrix[11] = (p01 - p10) - (p23 - p32);

  matrix[12] = -((p03 - p30) + (p12 - p21));
  matrix[13] = (p02 - p20) - (p13 - p31);
  matrix[14] = -((p01 - p10) + (p23 - p32));
  matrix[15] = (p00 + p11) + (p22 + p33);
}

// The inverse, for importers: `matrix` [4, 4] orthogonal with determinant +1. Of the two rotors +-r
// the one with s >= 0 where s is not zero.
//
// The sign patterns of the 16 products in rotor_to_matrix are mutually orthogonal, so projecting
// the matrix on them recovers all products at once: the rank-1 matrix K = a b^T. Its longest row
// gives b without dividing by anything small, and a = K b.
inline void matrix_to_rotor(const double* matrix /* [4, 4] */, double* rotor /* [8] */) {
  const double* m = matrix;
  const double k[4][4] = {{(m[0] + m[5]) + (m[10] + m[15]), (m[1] - m[4]) + (m[11] - m[14]),
                           (m[2] - m[8]) - (m[7] - m[13]), (m[3] - m[12]) + (m[6] - m[9])},
                          {(m[1] - m[4]) - (m[11] - m[14]), (m[10] + m[15]) - (m[0] + m[5]),
                           -((m[3] + m[12]) + (m[6] + m[9])), (m[2] + m[8]) - (m[7] + m[13])},
                          {(m[2] - m[8]) + (m[7] - m[13]), (m[3] + m[12]) - (m[6] + m[9]),
                           (m[5] - m[0]) + (m[15] - m[10]), -((m[1] + m[4]) + (m[11] + m[14]))},
                          {(m[6] - m[9]) - (m[3] - m[12]), (m[2] + m[8]) + (m[7] + m[13]),
                           (m[11] + m[14]) - (m[1] + m[4]), (m[0] - m[5]) + (m[15] - m[10])}};

  int longest = 0;
  double longest_norm2 = -1.0;
  for (int i = 0; i < 4; ++i) {
    const double* row = k[i];
    const double norm2 = (row[0] * row[0] + row[1] * row[1]) + (row[2] * row[2] + row[3] * row[3]);
    if (norm2 > longest_norm2) {
      longest = i;
      longest_norm2 = norm2;
    }
  }
  RotorHalves<double> h;
  for (int j = 0; j < 4; ++j) h.b[j] = k[longest][j];
  normalize_half(h.b);
  for (int i = 0; i < 4; ++i) {
    h.a[i] = (k[i][0] * h.b[0] + k[i][1] * h.b[1]) + (k[i][2] * h.b[2] + k[i][3] * h.b[3]);
  }
  normalize_half(h.a);  // also takes care of the factor 4 in k
  rotor_of_halves(h, rotor);
  if (rotor[kRotorS] < 0.0) {
    for (int i = 0; i < 8; ++i) rotor[i] = -rotor[i];
  }
}

}  // namespace l4d
