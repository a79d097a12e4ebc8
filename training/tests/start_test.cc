// SPDX-License-Identifier: Apache-2.0
// The first Gaussians of points: those far away fill the gaps between them, as near ones do.
#include "training/init/start.h"

#include <gtest/gtest.h>

#include <cmath>

#include "io/camera/read_cameras.h"

namespace l4d::train {
namespace {

// Cameras within 1 of the origin.
Capture capture_of_rig() {
  Capture capture;
  capture.fps = 10;
  capture.frames = 10;
  for (const double x : {-1.0, 1.0}) {
    CaptureCamera camera;
    camera.source.camera = io::default_camera();
    double* m = camera.source.camera.world_to_camera;
    m[0] = m[5] = m[10] = 1;
    m[3] = -x;
    camera.split = "train";
    capture.cameras.push_back(camera);
  }
  return capture;
}

// Points of a square grid at `depth`, `gap` apart: the standard deviation of their Gaussians.
double scale_at(double depth, double gap) {
  std::vector<Point> points;
  for (int k = 0; k < 100; ++k) {
    Point p{};
    p.position[0] = static_cast<float>(gap * (k % 10 - 4.5));
    p.position[1] = static_cast<float>(gap * (k / 10 - 4.5));
    p.position[2] = static_cast<float>(depth);
    points.push_back(p);
  }
  StartOptions options;
  options.count = options.capacity = points.size();
  options.sh_degree = 0;
  const ModelState state = start_model(capture_of_rig(), points, options);
  double sum = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    sum += std::exp(static_cast<double>(state.value.log_scale[4 * i]));
  }
  return sum / static_cast<double>(points.size());
}

TEST(Start, PointsOfASkyFillIt) {
  EXPECT_NEAR(scale_at(100, 0.8), 0.8, 0.1);
  EXPECT_NEAR(scale_at(1.5, 0.012), 0.012, 0.002);
  // What is as near as the cameras are to each other stays as small as before.
  EXPECT_NEAR(scale_at(0.5, 0.2), 0.05, 1e-6);
}

}  // namespace
}  // namespace l4d::train
