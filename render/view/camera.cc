// SPDX-License-Identifier: Apache-2.0
#include "render/view/camera.h"

#include <cmath>
#include <string>

namespace l4d::render {
namespace {

// Cameras come from files with few digits.
constexpr double kRotationTolerance = 1e-3;

}  // namespace

l4d_camera resolved(l4d_camera camera) {
  double* const m = camera.world_to_camera;
  if (camera.near_plane == 0) camera.near_plane = 0.02;
  bool unset = true;
  for (int k = 0; k < 12; ++k) unset = unset && (k % 4 == 3 || m[k] == 0);
  if (unset) m[0] = m[5] = m[10] = 1;
  return camera;
}

Status check_background(const float* rgb) {
  if (std::isfinite(rgb[0]) && std::isfinite(rgb[1]) && std::isfinite(rgb[2])) return {};
  return invalid_argument("the background is not finite");
}

Status check_image_size(uint32_t width, uint32_t height) {
  if (width <= L4D_MAX_IMAGE_SIDE && height <= L4D_MAX_IMAGE_SIDE) return {};
  return invalid_argument("width and height must be at most " + std::to_string(L4D_MAX_IMAGE_SIDE));
}

Status check_camera(const l4d_camera& c) {
  if (c.width < 1 || c.height < 1)
    return invalid_argument("camera: width and height must be at least 1");
  L4D_RETURN_IF_ERROR(check_image_size(c.width, c.height));
  if (!(c.fx > 0 && c.fy > 0) || !std::isfinite(c.fx) || !std::isfinite(c.fy) ||
      !std::isfinite(c.cx) || !std::isfinite(c.cy)) {
    return invalid_argument("camera: focal lengths must be above 0 and the principal point finite");
  }
  if (!(c.near_plane > 0) || !std::isfinite(c.near_plane)) {
    return invalid_argument("camera: near_plane must be at least 0 and finite");
  }
  for (const double v : c.world_to_camera) {
    if (!std::isfinite(v)) return invalid_argument("camera: world_to_camera is not finite");
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      const double* a = c.world_to_camera + 4 * i;
      const double* b = c.world_to_camera + 4 * j;
      const double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
      if (std::fabs(dot - (i == j ? 1 : 0)) > kRotationTolerance) {
        return invalid_argument("camera: world_to_camera does not begin with a rotation");
      }
    }
  }
  // Rows at right angles may still mirror the scene: then the third is against the cross product of
  // the others.
  const double* x = c.world_to_camera;
  const double* y = x + 4;
  const double* z = x + 8;
  const double determinant = z[0] * (x[1] * y[2] - x[2] * y[1]) +
                             z[1] * (x[2] * y[0] - x[0] * y[2]) +
                             z[2] * (x[0] * y[1] - x[1] * y[0]);
  if (!(determinant > 0)) {
    return invalid_argument(
        "camera: world_to_camera does not begin with a rotation but with a reflection");
  }
  return {};
}

}  // namespace l4d::render
