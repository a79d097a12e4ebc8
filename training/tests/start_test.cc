// SPDX-License-Identifier: Apache-2.0
// The first Gaussians of points: those far away fill the gaps between them, as near ones do.
#include "training/init/start.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "io/camera/read_cameras.h"
#include "training/tests/tiny_capture.h"

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
    camera.source.camera.width = camera.source.camera.height = 64;
    camera.source.camera.fx = camera.source.camera.fy = 32;
    camera.source.camera.cx = camera.source.camera.cy = 32;
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

std::string write_points(const test::Folder& folder, const std::string& type,
                         const std::string& row, const char* last = "blue") {
  const std::string path = folder / "points.ply";
  std::ofstream(path) << "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                         "property float y\nproperty float z\nproperty float t\nproperty "
                      << type << " red\nproperty " << type << " green\nproperty " << type << " "
                      << last << "\nend_header\n"
                      << row << "\n";
  return path;
}

// Colours and times of points may be in other units, and points in other coordinates.
TEST(Start, PointsAreReadAsTheyAreOrNamed) {
  const test::Folder folder;
  std::vector<std::string> notes;
  const auto read = [&](const std::string& path) {
    try {
      const std::vector<Point> points = read_points(path, {}, &notes);
      note_points(capture_of_rig(), points, &notes);
      return points.at(0).rgb[1];
    } catch (const io::Error& error) {
      notes.push_back(error.what());
      return -1.0f;
    }
  };
  EXPECT_EQ(read(write_points(folder, "float", "0 0 2 0.5 0 0.25 1")), 0.25f);
  EXPECT_EQ(read(write_points(folder, "uchar", "0 0 2 1 0 51 255")), 0.2f);
  EXPECT_TRUE(notes.empty());
  const std::string path = write_points(folder, "float", "0 0 2 0.5 0 128 255");
  EXPECT_EQ(read(path), -1);
  EXPECT_EQ(notes.back(), path + ": point 0 has the green 128; floats are from 0 to 1");
  EXPECT_EQ(read(write_points(folder, "ushort", "0 0 2 0.5 0 128 255")), -1);
  EXPECT_NE(notes.back().find("as uchar or as float"), std::string::npos) << notes.back();
  EXPECT_EQ(read(write_points(folder, "uchar", "0 0 2 0.5 0 128 255", "azure")), -1);
  EXPECT_EQ(notes.size(), 3U);
  EXPECT_EQ(read(write_points(folder, "uchar", "0 0 -2 9 0 51 255")), 0.2f);
  EXPECT_EQ(notes[3],
            "1 of 1 points have a time outside of the sequence; t is in seconds from its begin.");
  EXPECT_EQ(notes[4],
            "No camera sees any of the 1 points; they should be in the coordinates of the "
            "cameras.");
}

// A file for each frame: its points are of the frame's time, whatever t they have.
TEST(Start, PointsOfFramesAreAtTheirTimes) {
  const test::Folder folder;
  Capture capture = capture_of_rig();
  capture.views.clear();
  for (uint32_t k = 0; k < 3; ++k) capture.views.push_back({0, 2 * k, 0.5 * k, ""});
  const auto read = [&](uint64_t count, std::vector<std::string>* notes) {
    return frame_points(folder / "", capture, count, 1, {}, notes);
  };
  std::vector<std::string> notes;
  EXPECT_THROW(read(10, &notes), io::Error);  // there are none
  const std::string one = write_points(folder, "float", "0 0 2 9 0 0.25 1");
  for (const char* name : {"p_0002.ply", "p_4.ply", "p_5.ply"}) {
    std::filesystem::copy_file(one, folder / name);
  }
  EXPECT_THROW(read(10, &notes), io::Error);  // points.ply is of no frame
  std::filesystem::remove(one);
  const std::vector<Point> points = read(10, &notes);
  ASSERT_EQ(points.size(), 2U);
  EXPECT_EQ(points[0].time, 0.5f);
  EXPECT_EQ(points[1].time, 1.0f);
  EXPECT_TRUE(points[0].has_time && points[0].rgb[1] == 0.25f);
  EXPECT_EQ(notes, std::vector<std::string>{"1 of 3 files of points are of frames that the capture "
                                            "does not have."});
  std::filesystem::copy_file(folder / "p_4.ply", folder / "p_004.ply");
  EXPECT_THROW(read(10, &notes), io::Error);  // frame 4 twice
  std::filesystem::remove(folder / "p_004.ply");
  // Of many, about twice as many as are wanted, of each file alike.
  std::ofstream many(folder / "p_0.ply");
  many << "ply\nformat ascii 1.0\nelement vertex 3000\nproperty float x\nproperty float y\n"
          "property float z\nend_header\n";
  for (int i = 0; i < 3000; ++i) many << i << " 0 2\n";
  many.close();
  EXPECT_NEAR(static_cast<double>(read(300, &notes).size()), 202, 40);
  // What files lack is noted once, whichever of them is the first that is used.
  std::filesystem::copy_file(folder / "p_0.ply", folder / "p_2.ply");
  std::filesystem::remove(folder / "p_0002.ply");
  capture.views.erase(capture.views.begin());
  notes.clear();
  read(10, &notes);
  EXPECT_EQ(notes.size(), 2U);
  EXPECT_EQ(notes[0], (folder / "p_2.ply") + " has no red, green and blue; its points are grey.");
  // Reading is counted: more than the points take.
  const io::MemoryBudget budget("--limit-memory", 3000 * sizeof(Point));
  EXPECT_THROW(read_points(folder / "p_2.ply", budget.holder(), &notes), io::Error);
  EXPECT_EQ(budget.held(), 0U);
  capture.views.resize(1);
  capture.views[0].frame = 7;
  EXPECT_THROW(read(10, &notes), io::Error);
}

// TrainingNightly starts from these, and continuous integration does not run it.
TEST(Start, TruePointsAreRead) {
  const test::Folder folder;
  test::write_true_points(folder / "points.ply");
  std::vector<std::string> notes;
  EXPECT_EQ(read_points(folder / "points.ply", {}, &notes).size(), 3000U);
  EXPECT_TRUE(notes.empty());
}

}  // namespace
}  // namespace l4d::train
