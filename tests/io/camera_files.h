// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

#include "io/camera/cameras.h"
#include "tests/io/support.h"

namespace l4d::io::test {

// All files made here describe a camera at (5, 0, 0) that looks along -x, with z up: right is +y.
// Hence (1, 0.4, 0.6) lies 4 in front of it, 0.4 to the right and 0.6 above its axis.
constexpr double kPoint[3] = {1, 0.4, 0.6};

struct Pixel {
  double u = 0, v = 0, depth = 0;
};
inline Pixel project(const l4d_camera& camera, const double* point) {
  double p[3];
  for (size_t r = 0; r < 3; ++r) {
    const double* row = camera.world_to_camera + 4 * r;
    p[r] = row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3];
  }
  return {camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy, p[2]};
}

inline void expect_pixel(const l4d_camera& camera, double u, double v) {
  const Pixel pixel = project(camera, kPoint);
  EXPECT_NEAR(pixel.depth, 4, 1e-12);
  EXPECT_NEAR(pixel.u, u, 1e-9);
  EXPECT_NEAR(pixel.v, v, 1e-9);
}

inline const std::string kCamerasJson = R"({"fps": 25, "width": 640, "height": 480, "frames": 50,
 "cameras": [
  {"id": 7, "split": "test", "video": "sub/a.mp4",
   "K": [[500, 0, 300], [0, 400, 200], [0, 0, 1]],
   "w2c": [[0, 1, 0, 0], [0, 0, -1, 0], [-1, 0, 0, 5], [0, 0, 0, 1]]},
  {"id": 3, "width": 1280, "height": 720.0,
   "K": [[500.5, 0, 300], [0, 400, 200], [0, 0, 1]],
   "w2c": [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]}]})";

// camera_angle_x is 2 atan(320 / 500).
inline const std::string kTransforms = R"({"camera_angle_x": 1.1386263822013238, "w": 640, "h": 480,
 "frames": [
  {"file_path": "./train/r_000", "time": 0.25,
   "transform_matrix": [[0, 0, 1, 5], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]},
  {"file_path": "train/r_001.jpg", "time": 1.0,
   "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]})";

// One row of poses_bounds.npy.
inline const std::vector<double> kLlffRow = {0,   0,  1, 5, 480, 0,   1, 0,  0,
                                             640, -1, 0, 0, 0,   500, 1, 100};

inline std::string npy_header(const std::string& dictionary, char version = 1) {
  std::string header = std::string("\x93NUMPY") + version + '\0';
  const std::string text = dictionary + "\n";
  if (version == 1) {
    append<uint16_t>(header, static_cast<uint16_t>(text.size()));
  } else {
    append<uint32_t>(header, static_cast<uint32_t>(text.size()));
  }
  return header + text;
}

template <typename T>
std::string npy_rows(const std::vector<double>& row, size_t count) {
  std::string bytes;
  for (size_t i = 0; i < count; ++i) {
    for (const double value : row) append<T>(bytes, static_cast<T>(value));
  }
  return bytes;
}

}  // namespace l4d::io::test
