// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "libl4dcodec/scene/sh.h"
#include "render/frame/frame.h"
#include "render/frame/project.h"
#include "render/view/view.h"

// Derivatives of project() and shade(), one Gaussian at a time and for any floating-point type.
namespace l4d::render {

// Derivatives of the basis functions by x, y and z, as the polynomials they are: (x, y, z) need not
// stay on the sphere.
template <typename T>
L4D_HOST_DEVICE inline void sh_basis_gradient(uint32_t degree, T x, T y, T z,
                                              T (*by)[3] /* [(degree + 1)^2, 3] */) {
  using namespace sh_constant;
  const auto c = [](double v) { return static_cast<T>(v); };
  const auto set = [by](int k, T constant, T dx, T dy, T dz) {
    by[k][0] = constant * dx;
    by[k][1] = constant * dy;
    by[k][2] = constant * dz;
  };
  set(0, 0, 0, 0, 0);
  if (degree < 1) return;
  set(1, c(-k1), 0, 1, 0);
  set(2, c(k1), 0, 0, 1);
  set(3, c(-k1), 1, 0, 0);
  if (degree < 2) return;
  const T xx = x * x, yy = y * y, zz = z * z;
  set(4, c(k2[0]), y, x, 0);
  set(5, c(k2[1]), 0, z, y);
  set(6, c(k2[2]), -2 * x, -2 * y, 4 * z);
  set(7, c(k2[3]), z, 0, x);
  set(8, c(k2[4]), 2 * x, -2 * y, 0);
  if (degree < 3) return;
  set(9, c(k3[0]), 6 * x * y, 3 * (xx - yy), 0);
  set(10, c(k3[1]), y * z, x * z, x * y);
  set(11, c(k3[2]), -2 * x * y, 4 * zz - xx - 3 * yy, 8 * y * z);
  set(12, c(k3[3]), -6 * x * z, -6 * y * z, 6 * zz - 3 * xx - 3 * yy);
  set(13, c(k3[4]), 4 * zz - 3 * xx - yy, -2 * x * y, 8 * x * z);
  set(14, c(k3[5]), 2 * x * z, -2 * y * z, xx - yy);
  set(15, c(k3[6]), 3 * (xx - yy), -6 * x * y, 0);
}

// Back through shade(): adds the derivative by the position, for colour changes with the direction,
// and sets sh_gradient, which may be NULL. `by_color` is by the clamped colour if clamp_colors,
// else by the colour without the clamp.
template <typename T>
L4D_HOST_DEVICE void shade_gradient(const View<T>& view, uint32_t degree,
                                    const T* position /* [3] */,
                                    const float* sh /* [(degree + 1)^2, 3] */,
                                    const T* by_color /* [3] */, bool clamp_colors,
                                    T* by_position /* [3] */,
                                    T* sh_gradient /* [(degree + 1)^2, 3] */) {
  if (sh_gradient == nullptr && degree == 0) return;
  T direction[3], g[3] = {by_color[0], by_color[1], by_color[2]};
  view_direction(view, position, direction);
  if (clamp_colors) {
    T color[3];
    sh_color(degree, sh, direction, color);
    for (int c = 0; c < 3; ++c) {
      if (!(color[c] > 0)) g[c] = 0;
    }
  }
  if (sh_gradient != nullptr) {
    T basis[kMaxShTerms];
    sh_basis(degree, direction[0], direction[1], direction[2], basis);
    for (uint32_t k = 0; k < sh_terms(degree); ++k) {
      for (uint32_t c = 0; c < 3; ++c) sh_gradient[3 * k + c] = basis[k] * g[c];
    }
  }
  if (degree == 0) return;
  T by_basis[kMaxShTerms][3], by_direction[3] = {0, 0, 0};
  sh_basis_gradient(degree, direction[0], direction[1], direction[2], by_basis);
  for (uint32_t k = 1; k < sh_terms(degree); ++k) {
    T sum = 0;
    for (uint32_t c = 0; c < 3; ++c) sum += static_cast<T>(sh[3 * k + c]) * g[c];
    for (int j = 0; j < 3; ++j) by_direction[j] += sum * by_basis[k][j];
  }
  T norm2 = 0, along = 0;
  for (int j = 0; j < 3; ++j) {
    const T d = position[j] - view.center[j];
    norm2 += d * d;
    along += direction[j] * by_direction[j];
  }
  if (!(norm2 > 0)) return;
  const T norm = std::sqrt(norm2);
  for (int j = 0; j < 3; ++j) by_position[j] += (by_direction[j] - direction[j] * along) / norm;
}

// Adds what changes of the image covariance do through compensation(): by_c is by the entries of
// the covariance, [2, 2] symmetric; by_log is the derivative by the logarithm of the factor.
template <typename T>
L4D_HOST_DEVICE void compensation_gradient(const View<T>& view, const Projection<T>& projection,
                                           T by_log, T (*by_c)[2]) {
  // The logarithm is half of ln det before less ln det after; d(ln det C) = tr(C^-1 dC).
  const T* c = projection.covariance;
  const T xx = c[0] - view.rules.dilation, yy = c[2] - view.rules.dilation;
  const T before = xx * yy - c[1] * c[1], after = c[0] * c[2] - c[1] * c[1];
  if (!(before > 0 && after > 0)) return;
  const T half = by_log / 2;
  by_c[0][0] += half * (yy / before - c[2] / after);
  by_c[1][1] += half * (xx / before - c[0] / after);
  const T mixed = half * (c[1] / after - c[1] / before);
  by_c[0][1] += mixed;
  by_c[1][0] += mixed;
}

// Back through project_geometry() and the inverse of the image covariance: sets the derivatives by
// position and covariance. opacity: of the Gaussian, before compensation.
template <typename T>
L4D_HOST_DEVICE void geometry_gradient(const View<T>& view, const T* covariance /* [6] */,
                                       const Projection<T>& projection,
                                       const SplatGradient2D<T>& gradient, T opacity,
                                       SplatGradient3D<T>* out) {
  // conic = C^-1, so d(conic) = -conic dC conic.
  const T* c = projection.covariance;
  const T det = c[0] * c[2] - c[1] * c[1];
  const T k0 = c[2] / det, k1 = -c[1] / det, k2 = c[0] / det;
  const T g0 = gradient.conic[0], g1 = gradient.conic[1] / 2, g2 = gradient.conic[2];
  const T t00 = g0 * k0 + g1 * k1, t01 = g0 * k1 + g1 * k2;
  const T t10 = g1 * k0 + g2 * k1, t11 = g1 * k1 + g2 * k2;
  // By the entries of C, [2, 2] symmetric.
  T by_c[2][2] = {{-(k0 * t00 + k1 * t10), -(k0 * t01 + k1 * t11)},
                  {-(k0 * t01 + k1 * t11), -(k1 * t01 + k2 * t11)}};
  const T factor = compensation(view, projection);
  out->opacity = gradient.opacity * factor;
  if (view.rules.compensates) {
    compensation_gradient(view, projection, out->opacity * opacity, by_c);
  }

  // C = P S P^T with P = J W.
  const T* p[2] = {projection.jacobian, projection.jacobian + 3};
  T weighted[2][3];  // by_c P
  for (int k = 0; k < 2; ++k) {
    for (int i = 0; i < 3; ++i) weighted[k][i] = by_c[k][0] * p[0][i] + by_c[k][1] * p[1][i];
  }
  int entry = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j, ++entry) {
      const T sum = p[0][i] * weighted[0][j] + p[1][i] * weighted[1][j];
      out->covariance[entry] = i == j ? sum : 2 * sum;
    }
  }

  // P_k = focal_k / z (W_k - slope_k W_z), mean_k = focal_k x_k / z + origin_k.
  const T* s = covariance;
  const T full[9] = {s[0], s[1], s[2], s[1], s[3], s[4], s[2], s[4], s[5]};
  const T* r = view.rotation;
  const T focal[2] = {view.fx, view.fy};
  const T z = projection.camera[2];
  T by_camera[3] = {0, 0, 0};
  for (int k = 0; k < 2; ++k) {
    const T scale = focal[k] / z;
    T along = 0, by_slope = 0;
    for (int i = 0; i < 3; ++i) {
      const T by_p = 2 * (weighted[k][0] * full[i] + weighted[k][1] * full[3 + i] +
                          weighted[k][2] * full[6 + i]);
      along += by_p * p[k][i];
      by_slope -= by_p * scale * r[6 + i];
    }
    by_camera[2] -= along / z;
    if (!projection.clamped[k]) {
      by_camera[k] += by_slope / z;
      by_camera[2] -= by_slope * projection.slope[k] / z;
    }
    by_camera[k] += gradient.mean[k] * scale;
    by_camera[2] -= gradient.mean[k] * scale * projection.camera[k] / z;
  }
  for (int i = 0; i < 3; ++i) {
    out->position[i] = r[i] * by_camera[0] + r[3 + i] * by_camera[1] + r[6 + i] * by_camera[2];
  }
}

// Derivatives by Gaussian i of the frame, from those by its splat. `projection` is what project()
// kept. clamp_colors: a colour clamped at 0 has no derivative; without it the derivative passes, as
// if the image had been made of colours that are not clamped. Sets *out and sh_gradient, which may
// be NULL.
template <typename T>
void project_gradient(const View<T>& view, const Frame<T>& frame, size_t i,
                      const Projection<T>& projection, const SplatGradient2D<T>& gradient,
                      bool clamp_colors, SplatGradient3D<T>* out,
                      T* sh_gradient /* [(degree + 1)^2, 3] */) {
  const T position[3] = {frame.position[0][i], frame.position[1][i], frame.position[2][i]};
  T covariance[6];
  for (int k = 0; k < 6; ++k) covariance[k] = frame.covariance[k][i];
  geometry_gradient(view, covariance, projection, gradient, frame.opacity[i], out);
  shade_gradient(view, frame.sh_degree, position, frame.sh[i], gradient.color, clamp_colors,
                 out->position, sh_gradient);
}

}  // namespace l4d::render
