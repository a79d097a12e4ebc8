// SPDX-License-Identifier: Apache-2.0
#include "io/camera/grid.h"

#include <algorithm>
#include <cmath>

#include "io/camera/first_view.h"

namespace l4d::io {

CameraSet grid_cameras(const l4d_presentation& from, uint32_t columns, uint32_t rows, double spread,
                       uint32_t width, uint32_t height) {
  constexpr uint32_t kMost = 1000;
  if (columns < 1 || rows < 1 || columns > kMost || rows > kMost) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "a grid has 1 to 1000 columns and rows of cameras");
  }
  const l4d_camera middle = camera_of(from, width, height);
  const double* right = middle.world_to_camera;
  const double* down = right + 4;
  Vec3 up, target;
  double square = 0;
  for (size_t k = 0; k < 3; ++k) {
    up[k] = -down[k];
    target[k] = from.camera_target[k];
    square += std::pow(from.camera_target[k] - from.camera_position[k], 2);
  }
  const double step = spread * std::sqrt(square) / std::max(columns - 1.0, 1.0);
  CameraSet set;
  set.source = "grid";
  const uint32_t test = rows / 2 * columns + columns / 2;
  for (uint32_t id = 0; id < rows * columns; ++id) {
    const double x = step * (id % columns - (columns - 1) / 2.0);
    const double y = step * (id / columns - (rows - 1) / 2.0);
    Vec3 eye, forward;
    double length = 0;
    for (size_t k = 0; k < 3; ++k) {
      eye[k] = from.camera_position[k] + x * right[k] + y * down[k];
      forward[k] = target[k] - eye[k];
      length += forward[k] * forward[k];
    }
    for (double& f : forward) f /= std::sqrt(length);
    Camera camera;
    camera.id = static_cast<int>(id);
    camera.split = id == test ? "test" : "train";
    camera.camera = middle;
    place(eye, forward, up, camera.camera);
    set.cameras.push_back(std::move(camera));
  }
  set.notes.push_back("The cameras are made up: a grid around the first view.");
  return set;
}

}  // namespace l4d::io
