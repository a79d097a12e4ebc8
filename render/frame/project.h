// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>

#include "libl4dcodec/math/hd.h"
#include "libl4dcodec/scene/sh.h"
#include "render/frame/frame.h"
#include "render/view/view.h"

// From a 3D Gaussian to its splat in the image, one at a time and for any floating-point type. The
// reference rasteriser is made of it; the fast one does the same in vectors and falls back on it
// for derivatives.
namespace l4d::render {

// A Gaussian in the image. At offset (dx, dy) pixels from the mean
//   alpha = min(max_alpha, opacity exp(-q/2)),
//   q = conic[0] dx^2 + 2 conic[1] dx dy + conic[2] dy^2.
template <typename T>
struct Splat {
  T mean[2];   // pixels
  T conic[3];  // inverse of the covariance: xx xy yy, pixels^-2
  T depth;     // z in camera axes
  T opacity;   // times the compensation
  T color[3];  // clamped below at 0
  // Half-sizes of the box in which the splat shows.
  T extent[2];
  // It shows exactly where q <= reach: there alpha reaches min_alpha, and there it is not cut off.
  T reach;
};

// Derivatives of a scalar by what a Splat holds.
template <typename T>
struct SplatGradient2D {
  T mean[2]{};
  T conic[3]{};  // conic[1]: by the number itself, which q counts twice
  T opacity{};   // of the splat
  T color[3]{};  // by the clamped colour
};

// What projecting computes on the way, kept for the backward pass.
template <typename T>
struct Projection {
  T camera[3];  // position in camera axes
  T slope[2];   // clamped x/z, y/z
  bool clamped[2];
  T jacobian[6];    // [2, 3] of the pixel position by the world position: J W
  T covariance[3];  // xx xy yy, dilated, pixels^2
};

// False where the Gaussian lies at or before the near plane.
template <typename T>
L4D_HOST_DEVICE bool project_geometry(const View<T>& view, const T* position /* [3] */,
                                      const T* covariance /* [6] */, Projection<T>* out) {
  const T* r = view.rotation;
  for (int i = 0; i < 3; ++i) {
    out->camera[i] = r[3 * i] * position[0] + r[3 * i + 1] * position[1] +
                     r[3 * i + 2] * position[2] + view.translation[i];
  }
  const T z = out->camera[2];
  if (!(z > view.near_plane)) return false;
  const T focal[2] = {view.fx, view.fy};
  T jw[2][3];
  for (int k = 0; k < 2; ++k) {
    const T slope = out->camera[k] / z;
    out->slope[k] = std::min(std::max(slope, view.min_slope[k]), view.max_slope[k]);
    out->clamped[k] = out->slope[k] != slope;
    // d(pixel)/d(camera) = focal/z (e_k - slope e_z)
    const T scale = focal[k] / z;
    for (int c = 0; c < 3; ++c) jw[k][c] = scale * (r[3 * k + c] - out->slope[k] * r[6 + c]);
  }
  const T* s = covariance;
  const T full[9] = {s[0], s[1], s[2], s[1], s[3], s[4], s[2], s[4], s[5]};
  T t[2][3];  // J W Sigma
  for (int k = 0; k < 2; ++k) {
    for (int c = 0; c < 3; ++c) {
      t[k][c] = jw[k][0] * full[c] + jw[k][1] * full[3 + c] + jw[k][2] * full[6 + c];
      out->jacobian[3 * k + c] = jw[k][c];
    }
  }
  const T dilation = view.rules.dilation;
  out->covariance[0] = t[0][0] * jw[0][0] + t[0][1] * jw[0][1] + t[0][2] * jw[0][2] + dilation;
  out->covariance[1] = t[0][0] * jw[1][0] + t[0][1] * jw[1][1] + t[0][2] * jw[1][2];
  out->covariance[2] = t[1][0] * jw[1][0] + t[1][1] * jw[1][1] + t[1][2] * jw[1][2] + dilation;
  return true;
}

// The factor of the opacity that makes up for dilation: a splat of less than a pixel then adds as
// much light as it would without. 0 where the splat has no area before dilation.
template <typename T>
L4D_HOST_DEVICE T compensation(const View<T>& view, const Projection<T>& projection) {
  if (!view.rules.compensates) return 1;
  const T* c = projection.covariance;
  const T xx = c[0] - view.rules.dilation, yy = c[2] - view.rules.dilation;
  const T before = xx * yy - c[1] * c[1], after = c[0] * c[2] - c[1] * c[1];
  return before > 0 && after > 0 ? std::sqrt(before / after) : 0;
}

// The direction in which a camera sees a point. A camera inside the mean sees it along z.
template <typename T>
L4D_HOST_DEVICE inline void view_direction(const View<T>& view, const T* position /* [3] */,
                                           T* direction /* [3] */) {
  direction_from(view.center, position, view.rotation + 6, direction);
}

// A Gaussian as a splat, without colour; false where it touches no pixel of the view.
template <typename T>
L4D_HOST_DEVICE bool project(const View<T>& view, const T* position /* [3] */,
                             const T* covariance /* [6] */, T opacity, Splat<T>* out,
                             Projection<T>* kept) {
  if (!(opacity >= view.rules.min_alpha)) return false;
  Projection<T>& p = *kept;
  if (!project_geometry(view, position, covariance, &p)) return false;
  opacity *= compensation(view, p);
  if (!(opacity >= view.rules.min_alpha)) return false;
  const T det = p.covariance[0] * p.covariance[2] - p.covariance[1] * p.covariance[1];
  if (!(det > 0)) return false;
  out->mean[0] = view.fx * p.camera[0] / p.camera[2] + view.cx;
  out->mean[1] = view.fy * p.camera[1] / p.camera[2] + view.cy;
  out->conic[0] = p.covariance[2] / det;
  out->conic[1] = -p.covariance[1] / det;
  out->conic[2] = p.covariance[0] / det;
  out->depth = p.camera[2];
  out->opacity = opacity;
  out->reach = std::min(2 * std::log(opacity / view.rules.min_alpha), view.rules.max_reach);
  out->extent[0] = std::sqrt(out->reach * p.covariance[0]);
  out->extent[1] = std::sqrt(out->reach * p.covariance[2]);
  // Pixel centres lie at half-integers, from 0.5 to size - 0.5.
  const T half = static_cast<T>(0.5);
  return out->mean[0] + out->extent[0] >= half && out->mean[1] + out->extent[1] >= half &&
         out->mean[0] - out->extent[0] <= static_cast<T>(view.width) - half &&
         out->mean[1] - out->extent[1] <= static_cast<T>(view.height) - half;
}

// Gaussian i of a frame likewise.
template <typename T>
bool project(const View<T>& view, const Frame<T>& frame, size_t i, Splat<T>* out,
             Projection<T>* kept = nullptr) {
  const T position[3] = {frame.position[0][i], frame.position[1][i], frame.position[2][i]};
  T covariance[6];
  for (int k = 0; k < 6; ++k) covariance[k] = frame.covariance[k][i];
  Projection<T> local;
  return project(view, position, covariance, frame.opacity[i], out,
                 kept != nullptr ? kept : &local);
}

template <typename T>
void shade(const View<T>& view, const Frame<T>& frame, size_t i, Splat<T>* out) {
  const T position[3] = {frame.position[0][i], frame.position[1][i], frame.position[2][i]};
  T direction[3];
  view_direction(view, position, direction);
  sh_color(frame.sh_degree, frame.sh[i], direction, out->color);
  clamp_color(out->color);
}

}  // namespace l4d::render
