// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/ply/scene_ply.h"
#include "tests/io/stg_file.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using reference::Real;

class StgTest : public test::IoTest {
 protected:
  using Row = test::StgRow;

  std::string file(const std::vector<Row>& rows, const std::string& extra = "") const {
    return write("stg.ply", test::stg_ply(rows, extra));
  }

  static ImportOptions ten_seconds() {
    ImportOptions options;
    options.seconds = 10;
    options.fps = 5;
    return options;
  }
};

TEST_F(StgTest, LinearMotionIsExact) {
  Row row;
  row.motion[0] = 2;
  row.motion[1] = -1;
  row.motion[2] = 0.5;
  const Scene scene = read_scene_ply(file({row}), ten_seconds());
  EXPECT_EQ(scene.source, "stg_ply");
  EXPECT_EQ(scene.notes, std::vector<std::string>{});
  EXPECT_EQ(scene.timeline.num_frames, 50U);
  EXPECT_EQ(scene.mean_t[0], 5);
  EXPECT_EQ(scene.position, (std::vector<float>{1, 2, 3}));
  const test::ReferenceSlice s = test::reference_slice(scene, 0);
  EXPECT_NEAR(static_cast<double>(s.velocity[0]), 0.2, 1e-7);
  EXPECT_NEAR(static_cast<double>(s.velocity[1]), -0.1, 1e-7);
  EXPECT_NEAR(static_cast<double>(s.velocity[2]), 0.05, 1e-7);
  EXPECT_NEAR(static_cast<double>(s.sigma_t), 10 * std::exp(-2) / std::sqrt(2.0), 1e-6);
  const float wxyz[4] = {1, 0, 0, 0}, scale[3] = {-3, -4, -5};
  Real covariance[6];
  test::reference_covariance3(wxyz, scale, covariance);
  EXPECT_LT(reference::relative_error6(s.covariance, covariance), 1e-5);
  // Plain RGB: colour = 0.5 + Y0 * sh.
  EXPECT_EQ(scene.sh[0], 0);
  EXPECT_NEAR(scene.sh[1] * 0.28209479F + 0.5F, 0.75F, 1e-6);
}

TEST_F(StgTest, StillGaussiansHaveNoTemporalRotor) {
  const Scene scene = read_scene_ply(file({Row()}), ten_seconds());
  EXPECT_FALSE(test::has_motion(scene));
  EXPECT_EQ(scene.log_scale[1], -4);
}

// Far from both ends of the sequence the fit is that of the whole Gaussian: x + m2 s^2, v + 3 m3
// s^2.
TEST_F(StgTest, CurvesBecomeTheWeightedStraightLine) {
  Row row;
  row.log_width = std::log(0.05);
  row.motion[0] = 1;
  row.motion[3] = 4;    // quadratic x
  row.motion[7] = -20;  // cubic y
  const Scene scene = read_scene_ply(file({row}), ten_seconds());
  const double variance = 0.05 * 0.05 / 2;
  // 4 sigma of the Gaussian are used, not all of it.
  EXPECT_NEAR(scene.position[0], 1 + 4 * variance, 4 * variance * 1e-2);
  const test::ReferenceSlice s = test::reference_slice(scene, 0);
  EXPECT_NEAR(static_cast<double>(s.velocity[0]), 0.1, 1e-6);
  EXPECT_NEAR(static_cast<double>(s.velocity[1]), 3 * -20 * variance / 10, 1e-2 * 0.0075);
  ASSERT_EQ(scene.notes.size(), 1U);
  // At 4 sigma: 4 (16 - 1) s^2 across, 20 (64 - 12) s^3 the other way.
  const double sigma = std::sqrt(variance);
  const double largest = std::hypot(4 * 15 * variance, 20 * 52 * sigma * variance);
  double claimed = 0;
  ASSERT_EQ(std::sscanf(scene.notes[0].substr(scene.notes[0].find("at most ")).c_str(),
                        "at most %lf", &claimed),
            1);
  EXPECT_NEAR(claimed, largest, 0.06 * largest);  // samples lie a little inside of 4 sigma
  EXPECT_NE(scene.notes[0].find("1 Gaussian moves"), std::string::npos);
}

// A Gaussian wider than the sequence is fitted where it can be seen, not over its infinite tails.
TEST_F(StgTest, WideGaussiansAreFittedInsideTheSequence) {
  Row row;
  row.log_width = std::log(100.0);
  row.motion[4] = 1;  // y = dt^2 over dt in [-1/2, 1/2]: the best line is 1/12
  const Scene scene = read_scene_ply(file({row}), ten_seconds());
  EXPECT_NEAR(scene.position[1], 2 + 1.0 / 12, 1e-4);
  const test::ReferenceSlice s = test::reference_slice(scene, 0);
  EXPECT_NEAR(static_cast<double>(s.velocity[1]), 0, 1e-7);
}

TEST_F(StgTest, TurningIsFrozenAndReported) {
  Row row;
  row.log_width = std::log(0.1 * std::sqrt(2.0));
  row.omega[3] = 0.2;
  const Scene scene = read_scene_ply(file({row, Row()}), ten_seconds());
  EXPECT_FALSE(test::has_motion(scene));
  ASSERT_EQ(scene.notes.size(), 1U);
  double degrees = 0;
  ASSERT_EQ(std::sscanf(scene.notes[0].substr(scene.notes[0].find("at most ")).c_str(),
                        "at most %lf", &degrees),
            1);
  EXPECT_NEAR(degrees, 2 * std::atan(0.2 * 0.4) * 57.29578, 0.2);
  EXPECT_EQ(scene.notes[0].rfind("1 Gaussian turns", 0), 0U);
}

TEST_F(StgTest, FullModelsAreRefused) {
  for (const char* extra : {"property float f_t_0\n", "property float f_dc_3\n"}) {
    const std::string path = file({}, extra);
    std::string message;
    EXPECT_EQ(test::status_of([&] { read_scene_ply(path); }, &message),
              L4D_ERR_FEATURE_UNSUPPORTED);
    EXPECT_NE(message.find("neural network"), std::string::npos);
    EXPECT_NE(message.find("lite model"), std::string::npos);
  }
}

TEST_F(StgTest, MissingTimelineIsSaid) {
  const Scene scene = read_scene_ply(file({Row()}));
  EXPECT_EQ(scene.timeline.num_frames, 30U);
  ASSERT_EQ(scene.notes.size(), 1U);
  EXPECT_NE(scene.notes[0].find("no timeline"), std::string::npos);
}

}  // namespace
}  // namespace l4d::io
