// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "libl4dcodec/scene/attributes.h"
#include "libl4dcodec/scene/slice.h"
#include "libl4dcodec/scene/timeline.h"
#include "render/frame/frame.h"

// From the attributes of a 4D Gaussian to the 3D Gaussian of an instant, and derivatives back, one
// at a time and for any floating-point type. Only differences of times matter: with float, count
// them from a moment nearby.
namespace l4d::render {

// Attributes as l4d_gaussians gives them.
template <typename T>
struct Gaussian4D {
  T position[3];      // at the reference time, see position_time() below
  T mean_t;           // seconds
  T log_scale[4];     // x, y, z, t
  T rotor[8];         // of any length
  T opacity;          // a logit if the instant says so
  bool flat = false;  // does not fade; whether it is shown is not for here
};

// Derivatives of a scalar by the attributes.
template <typename T>
struct Gradient4D {
  T position[3]{};
  T mean_t{};
  T log_scale[4]{};
  T rotor[8]{};
  T opacity{};
  T time{};  // by the instant itself
};

// Gaussian i; its mean time is counted from `origin`.
template <typename T>
L4D_HOST_DEVICE inline Gaussian4D<T> read_gaussian(const l4d_gaussians& g, size_t i,
                                                   double origin) {
  Gaussian4D<T> out;
  for (size_t k = 0; k < 3; ++k) out.position[k] = static_cast<T>(g.position[3 * i + k]);
  out.mean_t = static_cast<T>(mean_time(g, i) - origin);
  for (size_t k = 0; k < 4; ++k) out.log_scale[k] = static_cast<T>(g.log_scale[4 * i + k]);
  for (size_t k = 0; k < 8; ++k) out.rotor[k] = static_cast<T>(g.rotor[8 * i + k]);
  out.opacity = static_cast<T>(g.opacity[i]);
  out.flat = window_of(g, i).is_flat();
  return out;
}

template <typename T>
struct Instant {
  T time;             // seconds
  T begin, end;       // of the sequence, seconds
  bool at_mean_time;  // L4D_POSITION_AT_MEAN_TIME
  bool logit;         // L4D_OPACITY_LOGIT
};

template <typename T>
struct Slice3D {
  T position[3];    // scene units
  T covariance[6];  // xx xy xz yy yz zz, scene units^2
  T opacity;        // temporal falloff applied
  bool visible;
};

// When the Gaussian is at its `position`.
template <typename T>
L4D_HOST_DEVICE inline T position_time(const Gaussian4D<T>& g, const Instant<T>& instant) {
  return instant.at_mean_time ? g.mean_t : reference_time(g.mean_t, instant.begin, instant.end);
}

template <typename T>
L4D_HOST_DEVICE inline T linear_opacity(const Gaussian4D<T>& g, const Instant<T>& instant) {
  return l4d::linear_opacity(g.opacity, instant.logit);
}

template <typename T>
L4D_HOST_DEVICE Slice3D<T> slice_at(const Gaussian4D<T>& g, const Instant<T>& instant) {
  const Slice4D<T> s = slice_attributes<T>(g.rotor, g.log_scale);
  const T elapsed = instant.time - position_time(g, instant);
  const T dt = instant.time - g.mean_t;
  Slice3D<T> out;
  for (int i = 0; i < 3; ++i) out.position[i] = g.position[i] + s.velocity[i] * elapsed;
  for (int k = 0; k < 6; ++k) out.covariance[k] = s.covariance[k];
  out.opacity = linear_opacity(g, instant) * (g.flat ? 1 : falloff(s.lambda, dt));
  out.visible = g.flat || is_visible(s.lambda, dt);
  return out;
}

// Back through normalize_half: what changes the length alone changes nothing. `raw` is the half
// before, `unit` after; a half too short to have a direction is constant.
template <typename T>
L4D_HOST_DEVICE inline void normalize_half_gradient(const T* raw /* [4] */, const T* unit /* [4] */,
                                                    T* gradient /* [4] */) {
  const T norm2 = dot4(raw, raw);
  const bool constant = norm2 < static_cast<T>(kMinHalfNorm2);
  const T along = dot4(unit, gradient), norm = std::sqrt(norm2);
  for (int k = 0; k < 4; ++k) {
    gradient[k] = constant ? 0 : (gradient[k] - unit[k] * along) / norm;
  }
}

// Back through rotor_to_matrix and the normalisation of both halves. Every entry of the matrix is a
// signed sum of products a[i] b[j]; collecting the signs of each product turns the derivative by
// the matrix into that by the outer product a b^T.
template <typename T>
L4D_HOST_DEVICE void rotor_gradient(const T* rotor /* [8] */, const T* matrix /* [4, 4] */,
                                    T* out /* [8] */) {
  const T* m = matrix;
  const T outer[4][4] = {{(m[0] + m[5]) + (m[10] + m[15]), (m[1] - m[4]) + (m[11] - m[14]),
                          (m[2] - m[8]) - (m[7] - m[13]), (m[3] - m[12]) + (m[6] - m[9])},
                         {(m[1] - m[4]) - (m[11] - m[14]), (m[10] + m[15]) - (m[0] + m[5]),
                          -((m[3] + m[12]) + (m[6] + m[9])), (m[2] + m[8]) - (m[7] + m[13])},
                         {(m[2] - m[8]) + (m[7] - m[13]), (m[3] + m[12]) - (m[6] + m[9]),
                          (m[5] - m[0]) + (m[15] - m[10]), -((m[1] + m[4]) + (m[11] + m[14]))},
                         {(m[6] - m[9]) - (m[3] - m[12]), (m[2] + m[8]) + (m[7] + m[13]),
                          (m[11] + m[14]) - (m[1] + m[4]), (m[0] - m[5]) + (m[15] - m[10])}};
  const RotorHalves<T> raw = halves_of_rotor(rotor);
  const RotorHalves<T> unit = normalized_halves(rotor);
  T a[4], b[4];
  for (int i = 0; i < 4; ++i) {
    a[i] = dot4(outer[i], unit.b);
    b[i] = (outer[0][i] * unit.a[0] + outer[1][i] * unit.a[1]) +
           (outer[2][i] * unit.a[2] + outer[3][i] * unit.a[3]);
  }
  normalize_half_gradient(raw.a, unit.a, a);
  normalize_half_gradient(raw.b, unit.b, b);
  out[kRotorS] = a[0] + b[0];
  out[kRotorP] = a[0] - b[0];
  out[kRotorB01] = a[1] + b[1];
  out[kRotorB23] = b[1] - a[1];
  out[kRotorB02] = a[2] + b[2];
  out[kRotorB13] = a[2] - b[2];
  out[kRotorB12] = a[3] + b[3];
  out[kRotorB03] = b[3] - a[3];
}

// The spatial rows m without their part along m_t, p = m - lambda (m m_t) m_t, as slice_rows has
// them. There the entry along a long time axis is a difference of two long numbers; its error does
// no harm to the covariance, but derivatives multiply it by the temporal scale. Here every entry is
// a sum over 2x2 minors of the rotation, where scales only multiply:
//   p_k = lambda sum_a m_t,a (m_k m_t,a - m_a m_t,k) + m_k (1 - lambda |m_t|^2)
template <typename T>
L4D_HOST_DEVICE void projected_rows(const T* rotation /* [4, 4] */, const T* scale /* [4] */,
                                    T lambda, bool clamped, T (*p)[4] /* [3, 4] */) {
  const T* rt = rotation + 12;
  T mt[4];
  for (int a = 0; a < 4; ++a) mt[a] = scale[a] * rt[a];
  const T rest = clamped ? 1 - lambda * dot4(mt, mt) : 0;
  for (int i = 0; i < 3; ++i) {
    const T* r = rotation + 4 * i;
    for (int k = 0; k < 4; ++k) {
      T sum = 0;
      for (int a = 0; a < 4; ++a) {
        if (a != k) sum += scale[a] * mt[a] * (r[k] * rt[a] - r[a] * rt[k]);
      }
      p[i][k] = scale[k] * (lambda * sum + rest * r[k]);
    }
  }
}

// By the opacity as it is stored, from that by the opacity of the slice; lambda as slices have it.
template <typename T>
L4D_HOST_DEVICE inline T opacity_gradient(const Gaussian4D<T>& g, const Instant<T>& instant,
                                          T lambda, T by_slice) {
  T out = by_slice * (g.flat ? 1 : falloff(lambda, instant.time - g.mean_t));
  // 1 - opacity of a large logit would be nothing but rounding.
  if (instant.logit) out *= linear_opacity(g, instant) / (1 + std::exp(g.opacity));
  return out;
}

template <typename T>
L4D_HOST_DEVICE inline T opacity_gradient(const Gaussian4D<T>& g, const Instant<T>& instant,
                                          T by_slice) {
  const T lambda = g.flat ? 0 : slice_attributes<T>(g.rotor, g.log_scale).lambda;
  return opacity_gradient(g, instant, lambda, by_slice);
}

// Derivatives by the attributes, from those by the slice at the same instant. A Gaussian that is
// not visible has none; this does not ask.
template <typename T>
L4D_HOST_DEVICE Gradient4D<T> slice_gradient(const Gaussian4D<T>& g, const Instant<T>& instant,
                                             const SplatGradient3D<T>& gradient) {
  Gradient4D<T> out;
  T scale[4], rotation[16], rows[16];
  for (int k = 0; k < 4; ++k) scale[k] = std::exp(g.log_scale[k]);
  rotor_to_matrix(normalized_halves(g.rotor), rotation);
  for (int i = 0; i < 16; ++i) rows[i] = rotation[i] * scale[i & 3];
  const Slice4D<T> s = slice_rows(rows);
  const T lambda = s.lambda;
  const T* mt = rows + 12;
  const bool clamped = !(dot4(mt, mt) > static_cast<T>(kMinTemporalVariance));

  // opacity(t) = opacity falloff
  const T dt = instant.time - g.mean_t;
  const T linear = linear_opacity(g, instant);
  const T left = g.flat ? 1 : falloff(lambda, dt);
  out.opacity = opacity_gradient(g, instant, lambda, gradient.opacity);
  const T shown = g.flat ? 0 : gradient.opacity * linear * left;
  out.mean_t = shown * lambda * dt;
  out.time = -out.mean_t;
  const T by_lambda = clamped ? 0 : -shown * (dt * dt) / 2;

  // position(t) = position + velocity (t - t_ref)
  const T elapsed = instant.time - position_time(g, instant);
  const bool moves_reference =
      instant.at_mean_time || (g.mean_t >= instant.begin && g.mean_t <= instant.end);
  T by_velocity[3];
  for (int i = 0; i < 3; ++i) {
    out.position[i] = gradient.position[i];
    by_velocity[i] = gradient.position[i] * elapsed;
    out.time += gradient.position[i] * s.velocity[i];
    if (moves_reference) out.mean_t -= gradient.position[i] * s.velocity[i];
  }

  // covariance = p p^T with p = m - velocity m_t of the spatial rows m, and p m_t = 0 unless lambda
  // is clamped: only then does the covariance see the velocity.
  const T* c = gradient.covariance;
  const T full[9] = {2 * c[0], c[1], c[2], c[1], 2 * c[3], c[4], c[2], c[4], 2 * c[5]};
  T p[3][4], by_p[3][4];
  projected_rows(rotation, scale, lambda, clamped, p);
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 4; ++k) {
      by_p[i][k] = full[3 * i] * p[0][k] + full[3 * i + 1] * p[1][k] + full[3 * i + 2] * p[2][k];
    }
    if (clamped) by_velocity[i] -= dot4(by_p[i], mt);
  }

  // velocity = lambda m m_t, lambda = 1 / |m_t|^2. The derivative by log_scale is put together from
  // short vectors p where it can be: that by the rows would take it from the difference of long
  // ones.
  T by_row[16];
  for (int k = 0; k < 4; ++k) {
    const T shrink = -2 * (lambda * lambda) * by_lambda * mt[k];
    T by_mt = shrink, by_scale = shrink * mt[k];
    for (int i = 0; i < 3; ++i) {
      const T m = rows[4 * i + k], v = s.velocity[i];
      by_row[4 * i + k] = by_p[i][k] + by_velocity[i] * lambda * mt[k];
      by_mt += by_velocity[i] * lambda * (clamped ? m : p[i][k] - v * mt[k]) - v * by_p[i][k];
      by_scale +=
          p[i][k] * by_p[i][k] + 2 * by_velocity[i] * lambda * mt[k] * (clamped ? m : p[i][k]);
    }
    by_row[12 + k] = by_mt;
    out.log_scale[k] = by_scale;
  }
  for (int i = 0; i < 16; ++i) by_row[i] *= scale[i & 3];
  rotor_gradient(g.rotor, by_row, out.rotor);
  return out;
}

}  // namespace l4d::render
