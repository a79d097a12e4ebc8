// SPDX-License-Identifier: Apache-2.0
// What a training hands over besides the Gaussians.
#include "training/run/train/output.h"

#include <gtest/gtest.h>

#include <cmath>

#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

// The first view is that of a training camera: its target lies on the axis, its up is the image's.
TEST(Output, StatesATrainingCameraAsTheFirstView) {
  Capture capture = read_capture(test::tiny_capture(), {});
  const ImageLoader loader(capture, 1);
  const l4d_presentation p = first_view(capture, loader);
  ASSERT_EQ(p.has_camera, 1U);
  EXPECT_EQ(p.has_bounds, 0U);
  size_t found = capture.cameras.size();
  for (size_t c = 0; c < capture.cameras.size(); ++c) {
    double at[3];
    camera_center(capture.cameras[c].source.camera, at);
    if (std::equal(at, at + 3, p.camera_position)) found = c;
  }
  ASSERT_LT(found, capture.cameras.size());
  EXPECT_EQ(capture.cameras[found].split, "train");
  const l4d_camera& camera = capture.cameras[found].source.camera;
  const double* m = camera.world_to_camera;
  for (size_t r = 0; r < 3; ++r) {
    double target = m[4 * r + 3], up = 0;
    for (size_t k = 0; k < 3; ++k) {
      target += m[4 * r + k] * p.camera_target[k];
      up += m[4 * r + k] * p.camera_up[k];
    }
    // Cameras of the capture stand around the scene: the target is in it.
    const double radius = frame_of(capture).radius;
    EXPECT_NEAR(target, r < 2 ? 0 : radius, r < 2 ? 1e-9 : 0.5 * radius);
    EXPECT_NEAR(up, r == 1 ? -1 : 0, 1e-9);
  }
  EXPECT_NEAR(std::tan(p.camera_fov / 2) * camera.fy, camera.height / 2.0, 1e-9);

  // Text keeps it.
  const l4d_presentation read = as_read(p);
  EXPECT_EQ(read.has_camera, 1U);
  EXPECT_NEAR(read.camera_fov, p.camera_fov, 1e-12);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(read.camera_position[k], p.camera_position[k]);
    EXPECT_EQ(read.camera_target[k], p.camera_target[k]);
    EXPECT_EQ(read.camera_up[k], p.camera_up[k]);
  }
}

// One camera alone looks at what is away from it; without a training camera nothing is stated.
TEST(Output, StatesAViewOfWhateverCamerasThereAre) {
  Capture capture = read_capture(test::tiny_capture(), {});
  const ImageLoader loader(capture, 1);
  for (size_t c = 0; c < capture.cameras.size(); ++c) {
    capture.cameras[c].split = c == 3 ? "train" : "test";
  }
  const l4d_presentation one = first_view(capture, loader);
  double squared = 0;
  for (size_t k = 0; k < 3; ++k) {
    squared += std::pow(one.camera_target[k] - one.camera_position[k], 2);
  }
  EXPECT_NEAR(std::sqrt(squared), frame_of(capture).radius, 1e-9);
  capture.cameras[3].split = "test";
  EXPECT_EQ(first_view(capture, loader).has_camera, 0U);
}

}  // namespace
}  // namespace l4d::train
