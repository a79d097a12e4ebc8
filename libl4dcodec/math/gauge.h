// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "libl4dcodec/math/rotor.h"

// Encoder side. The same Gaussian has many parameters: a rotor and its negative are one rotation,
// and turning the local frame by a symmetry of the cube while the three spatial scales change
// places leaves the covariance as it was. Choosing one representative by rule makes similar
// Gaussians have similar parameters, which is what vector quantisation lives on.
namespace l4d {

enum class GaugeMode {
  kSign,             // s >= 0, the frame as it is; changes nothing but signs
  kNearestIdentity,  // of the 24 frames the one whose rotor is nearest the identity
  kSortedScales  // spatial scales in descending order, nearest identity among the frames that allow
                 // it
};

// One of the 24 rotations of the cube, which act on the local spatial axes.
struct CubeRotation {
  int q[4];     // w, x, y, z of a quaternion of squared length norm2
  int norm2;    // 1, 2 or 4
  int axis[3];  // local axis j of the turned frame is +- axis[j] of the old one
};

// The identity comes first: ties keep the frame as it is.
constexpr int kNumCubeRotations = 24;
constexpr CubeRotation kCubeRotations[kNumCubeRotations] = {
    {{1, 0, 0, 0}, 1, {0, 1, 2}},   {{0, 1, 0, 0}, 1, {0, 1, 2}},   {{0, 0, 1, 0}, 1, {0, 1, 2}},
    {{0, 0, 0, 1}, 1, {0, 1, 2}},   {{1, 1, 0, 0}, 2, {0, 2, 1}},   {{1, -1, 0, 0}, 2, {0, 2, 1}},
    {{0, 0, 1, 1}, 2, {0, 2, 1}},   {{0, 0, 1, -1}, 2, {0, 2, 1}},  {{1, 0, 1, 0}, 2, {2, 1, 0}},
    {{1, 0, -1, 0}, 2, {2, 1, 0}},  {{0, 1, 0, 1}, 2, {2, 1, 0}},   {{0, 1, 0, -1}, 2, {2, 1, 0}},
    {{1, 0, 0, 1}, 2, {1, 0, 2}},   {{1, 0, 0, -1}, 2, {1, 0, 2}},  {{0, 1, 1, 0}, 2, {1, 0, 2}},
    {{0, 1, -1, 0}, 2, {1, 0, 2}},  {{1, 1, 1, 1}, 4, {1, 2, 0}},   {{1, 1, -1, -1}, 4, {1, 2, 0}},
    {{1, -1, 1, -1}, 4, {1, 2, 0}}, {{1, -1, -1, 1}, 4, {1, 2, 0}}, {{1, -1, -1, -1}, 4, {2, 0, 1}},
    {{1, -1, 1, 1}, 4, {2, 0, 1}},  {{1, 1, -1, 1}, 4, {2, 0, 1}},  {{1, 1, 1, -1}, 4, {2, 0, 1}},
};

// Turns the local spatial frame of one half. In Hamilton's convention the half (a0, a1, a2, a3) is
// the quaternion w = a0, x = -a3, y = a2, z = -a1; the product is from the right and divided by the
// length.
inline void turn_half(const CubeRotation& turn, double* half /* [4] */) {
  const double w = half[0], x = -half[3], y = half[2], z = -half[1];
  const double qw = turn.q[0], qx = turn.q[1], qy = turn.q[2], qz = turn.q[3];
  const double length = square_root(static_cast<double>(turn.norm2));
  half[0] = (w * qw - x * qx - y * qy - z * qz) / length;
  half[3] = -(w * qx + x * qw + y * qz - z * qy) / length;
  half[2] = (w * qy - x * qz + y * qw + z * qx) / length;
  half[1] = -(w * qz + x * qy - y * qx + z * qw) / length;
}

// Makes s >= 0, or where s is 0 the first other coefficient that is not. Also turns -0 into +0, so
// that equal values have equal bits.
template <typename T>
inline void canonicalize_sign(T* rotor /* [8] */) {
  int first = 0;
  while (first < 7 && rotor[first] == static_cast<T>(0)) ++first;
  const bool negative = rotor[first] < static_cast<T>(0);
  for (int i = 0; i < 8; ++i) {
    rotor[i] = (negative ? -rotor[i] : rotor[i]) + static_cast<T>(0);
  }
}

// The sign of the half B is free too: (A, -B) is the rotation times -1, which leaves the covariance
// as it was. Chosen so that A and B are no more than a right angle apart, or the temporal part of
// the rotor no longer than the spatial one: it then mixes time and space by no more than it must,
// and no half is near -1 while the other is near 1. A matter of which number stands where.
template <typename T>
inline void align_halves(T* rotor /* [8] */) {
  T spatial = 0, temporal = 0;
  for (int i = 0; i < 4; ++i) spatial += rotor[i] * rotor[i];
  for (int i = 4; i < 8; ++i) temporal += rotor[i] * rotor[i];
  if (!(temporal > spatial)) return;
  const T s = rotor[kRotorS], b01 = rotor[kRotorB01], b02 = rotor[kRotorB02],
          b12 = rotor[kRotorB12];
  rotor[kRotorS] = rotor[kRotorP];
  rotor[kRotorB01] = -rotor[kRotorB23];
  rotor[kRotorB02] = rotor[kRotorB13];
  rotor[kRotorB12] = -rotor[kRotorB03];
  rotor[kRotorB03] = -b12;
  rotor[kRotorB13] = b02;
  rotor[kRotorB23] = -b01;
  rotor[kRotorP] = s;
}

// Which rotation of the cube takes the Gaussian to its representative; an index into
// kCubeRotations. The nearest rotor to the identity is the one with the largest |s|.
template <typename T>
inline int choose_cube_rotation(const RotorHalves<double>& halves, const T* log_scale /* [4] */,
                                GaugeMode mode) {
  if (mode == GaugeMode::kSign) return 0;
  // Parts of the spatial half of the rotor, as a quaternion.
  const double w = (halves.a[0] + halves.b[0]) * 0.5, x = -(halves.a[3] + halves.b[3]) * 0.5;
  const double y = (halves.a[2] + halves.b[2]) * 0.5, z = -(halves.a[1] + halves.b[1]) * 0.5;
  // Frames tie often in hand-made scenes. Within this margin the earlier one wins, so that a
  // representative stays its own representative whatever the rounding.
  const double margin = 1e-6;
  int best = -1;
  double best_s = 0.0;
  for (int i = 0; i < kNumCubeRotations; ++i) {
    const CubeRotation& turn = kCubeRotations[i];
    if (mode == GaugeMode::kSortedScales && !(log_scale[turn.axis[0]] >= log_scale[turn.axis[1]] &&
                                              log_scale[turn.axis[1]] >= log_scale[turn.axis[2]])) {
      continue;
    }
    double s = (w * turn.q[0] - x * turn.q[1] - y * turn.q[2] - z * turn.q[3]) /
               square_root(static_cast<double>(turn.norm2));
    s = s < 0.0 ? -s : s;
    if (best < 0 || s > best_s + margin) {
      best = i;
      best_s = s;
    }
  }
  return best < 0 ? 0 : best;  // only NaN scales sort in no order
}

// Replaces a Gaussian's rotor and log scales by those of its representative: the same covariance in
// space-time. Except in mode kSign the rotor comes back normalised, and is computed in double and
// rounded once. A rotor with no temporal part keeps having none, exactly.
template <typename T>
inline void canonicalize(T* rotor /* [8] */, T* log_scale /* [4] */, GaugeMode mode) {
  if (mode != GaugeMode::kSign) {
    double wide[8];
    for (int i = 0; i < 8; ++i) wide[i] = static_cast<double>(rotor[i]);
    RotorHalves<double> halves = normalized_halves(wide);
    const CubeRotation& turn = kCubeRotations[choose_cube_rotation(halves, log_scale, mode)];
    turn_half(turn, halves.a);
    turn_half(turn, halves.b);
    rotor_of_halves(halves, wide);
    for (int i = 0; i < 8; ++i) rotor[i] = static_cast<T>(wide[i]);
    const T old[3] = {log_scale[0], log_scale[1], log_scale[2]};
    for (int j = 0; j < 3; ++j) log_scale[j] = old[turn.axis[j]];
  }
  canonicalize_sign(rotor);
}

}  // namespace l4d
