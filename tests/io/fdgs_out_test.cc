// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "io/formats/clusters.h"
#include "io/formats/scene_file.h"
#include "io/formats/write_4dgs.h"
#include "io/ply/scene_ply.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

class FdgsOutTest : public test::IoTest {
 protected:
  Scene back(const Scene& scene, WriteNotes* notes = nullptr) {
    const WriteNotes found = write_4dgs(path("a.4dgs"), scene);
    if (notes != nullptr) *notes = found;
    return read_scene_file(path("a.4dgs"), path("a.4dgs"));
  }
};

// Gaussians that are all seen, in the order of their opacities, which says who is who.
Scene seen_scene(size_t count, uint32_t degree) {
  Scene scene = test::random_scene(5, count, degree);
  scene.timeline.time_begin = 100;
  reference::Random random(6);
  for (size_t i = 0; i < count; ++i) {
    scene.mean_t[i] = static_cast<float>(100 + random.uniform(0, 5));
    scene.opacity[i] = std::log((static_cast<float>(i) + 1) / static_cast<float>(count));
    scene.log_scale[4 * i + 3] = static_cast<float>(random.uniform(-5, 0));
  }
  scene.flags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  return scene;
}

std::vector<size_t> by_opacity(const Scene& scene) {
  std::vector<size_t> order(scene.count());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [&](size_t a, size_t b) { return scene.opacity[a] < scene.opacity[b]; });
  return order;
}

// What a scene states and neither format has a place for is named; the rest is not.
TEST_F(FdgsOutTest, LostStatementsAreNoted) {
  Scene scene = seen_scene(20, 0);
  set_fps(scene.timeline, 24);
  scene.placement.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
  scene.placement.color_space = L4D_COLOR_LINEAR_SRGB;
  scene.presentation.metres_per_unit = 2;
  const auto lost = [](const std::string& format, const std::string& lines) {
    return WriteNotes::value_type(format + " has no place for what the scene states: " + lines, 0);
  };
  const auto has = [](const WriteNotes& notes, const WriteNotes::value_type& note) {
    return std::find(notes.begin(), notes.end(), note) != notes.end();
  };
  EXPECT_TRUE(has(write_4dgs(path("a.4dgs"), scene), lost(".4dgs", "time_begin 100")));
  EXPECT_TRUE(
      has(write_ftgs_ply(path("a.ply"), scene), lost("FreeTimeGS", "time_begin 100; fps 24")));
  scene.placement.origin[1] = 7;
  scene.placement.scale = 3;
  scene.placement.coordinate_system = L4D_COORDINATES_UNKNOWN;
  scene.rendering.dilation = 0.125F;
  EXPECT_TRUE(has(write_4dgs(path("a.4dgs"), scene),
                  lost(".4dgs",
                       "time_begin 100; l4d_origin 0 7 0; l4d_scale 3; l4d_rendering "
                       "dilation=0.125; l4d_presentation metres_per_unit=2")));
  Scene plain = test::random_scene(5, 20, 0);
  plain.timeline.time_begin = 0;
  set_fps(plain.timeline, 30);
  EXPECT_TRUE(write_ftgs_ply(path("a.ply"), plain).empty());
}

// Each of the writers asks often enough: for each of the columns and bands, and while it looks for
// a palette.
TEST_F(FdgsOutTest, WritersEndWhereTheyAreTold) {
  size_t left = 0;
  const Check check = [&] {
    if (left-- == 0) throw Error(L4D_ERR_CANCELLED, "no longer wanted");
  };
  const Scene scene = seen_scene(20, 2);
  for (left = 0; left < 12;) {
    const size_t calls = left;
    EXPECT_EQ(test::status_of([&] { write_4dgs(path("a.4dgs"), scene, check); }),
              L4D_ERR_CANCELLED);
    left = calls + 1;
  }
  EXPECT_EQ(test::status_of([&] {
              std::vector<float> rows(40);
              for (size_t i = 0; i < rows.size(); ++i) rows[i] = static_cast<float>(i);
              left = 15;
              palette_of(rows, 2, 20, check);
            }),
            L4D_ERR_CANCELLED);
  EXPECT_EQ(files_in_directory(), 0U);
}

TEST_F(FdgsOutTest, NumbersThatAreNotFiniteAreRefused) {
  for (const auto& write :
       {std::function<void(const Scene&)>([&](const Scene& s) { write_4dgs(path("a.4dgs"), s); }),
        std::function<void(const Scene&)>(
            [&](const Scene& s) { write_ftgs_ply(path("a.ply"), s); })}) {
    for (std::vector<float> Scene::*values : {&Scene::position, &Scene::mean_t, &Scene::log_scale,
                                              &Scene::rotor, &Scene::opacity, &Scene::sh}) {
      Scene scene = seen_scene(20, 1);
      const size_t per_gaussian = (scene.*values).size() / scene.count();
      (scene.*values)[7 * per_gaussian] = std::numeric_limits<float>::quiet_NaN();
      try {
        write(scene);
        ADD_FAILURE() << "was written";
      } catch (const Error& error) {
        EXPECT_EQ(error.status(), L4D_ERR_INVALID_SCENE);
        EXPECT_NE(std::string(error.what()).find("Gaussian 7"), std::string::npos) << error.what();
      }
    }
  }
}

TEST_F(FdgsOutTest, ASceneThatIsTooWideIsNoted) {
  const std::string note = "Gaussians are smaller than steps of position, as the scene is so wide";
  WriteNotes notes;
  Scene scene = seen_scene(20, 0);
  back(scene, &notes);
  EXPECT_EQ(notes.count(note), 0u);
  scene.position[0] = 1e17f;
  back(scene, &notes);
  EXPECT_EQ(notes[note], 20u);
}

TEST_F(FdgsOutTest, KeepsWhatGaussiansAreToTheStepsOfTheFormat) {
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    const Scene scene = seen_scene(200, degree);
    WriteNotes notes;
    const Scene read = back(scene, &notes);
    ASSERT_EQ(read.count(), scene.count());
    EXPECT_EQ(read.timeline.num_frames, scene.timeline.num_frames);
    EXPECT_EQ(read.timeline.fps_num, scene.timeline.fps_num);
    EXPECT_EQ(read.sh_degree, degree);
    const std::vector<size_t> order = by_opacity(read);
    for (size_t i = 0; i < scene.count(); ++i) {
      const size_t j = order[i];
      const test::ReferenceSlice a = test::reference_slice(scene, i);
      const test::ReferenceSlice b = test::reference_slice(read, j);
      const double sigma = static_cast<double>(a.sigma_t);
      EXPECT_NEAR(static_cast<double>(b.sigma_t) / sigma, 1, 0.005);
      const double time = static_cast<double>(scene.mean_t[i]) - 100;
      EXPECT_NEAR(static_cast<double>(read.mean_t[j]), time, 0.026 * sigma + 1e-6);
      const double size = std::sqrt(
          static_cast<double>(std::max({a.covariance[0], a.covariance[3], a.covariance[5]})));
      for (size_t k = 0; k < 6; ++k) {
        EXPECT_NEAR(static_cast<double>(b.covariance[k]), static_cast<double>(a.covariance[k]),
                    0.02 * size * size);
      }
      // Where it is at both ends of its life.
      for (const double at : {-4 * sigma, 4 * sigma}) {
        for (size_t k = 0; k < 3; ++k) {
          const double wanted = static_cast<double>(scene.position[3 * i + k]) +
                                static_cast<double>(a.velocity[k]) * at;
          const double found = static_cast<double>(read.position[3 * j + k]) +
                               static_cast<double>(b.velocity[k]) *
                                   (time + at - static_cast<double>(read.mean_t[j]));
          EXPECT_NEAR(found, wanted, 2e-3) << i << " " << k;
        }
      }
      const double opacity = (static_cast<double>(i) + 1) / static_cast<double>(scene.count());
      EXPECT_NEAR(static_cast<double>(read.opacity[j]), opacity / (1 + opacity), 1.0 / 4096 + 1e-6);
      const size_t numbers = 3 * scene.sh_coefficients();
      for (size_t k = 0; k < numbers; ++k) {
        const float limit = k < 3 ? 0.5F / 0.28209479F : 4.0F;
        const float wanted = std::clamp(scene.sh[numbers * i + k], -limit, limit);
        EXPECT_NEAR(read.sh[numbers * j + k], wanted, k < 3 ? 0.0036 : 4 / 255.0 + 1e-6);
      }
    }
    EXPECT_EQ(notes.count("Gaussians had a base colour outside 0 to 1, now limited"), 1U);
  }
}

TEST_F(FdgsOutTest, WindowsStayAsTheyAre) {
  Scene scene = seen_scene(4, 0);
  scene.window = {0, 0, 3, 7, 0, 150, 3, 7};
  const Scene read = back(scene);
  const std::vector<size_t> order = by_opacity(read);
  for (const size_t i : {1U, 3U}) {
    EXPECT_EQ(read.window[2 * order[i]], 3U);
    EXPECT_EQ(read.window[2 * order[i] + 1], 7U);
  }
  EXPECT_EQ(read.window[2 * order[0] + 1], 0U);
  EXPECT_EQ(read.window[2 * order[2] + 1], 0U) << "the whole sequence is no window";
  const test::ReferenceSlice slice = test::reference_slice(scene, 1);
  for (size_t k = 0; k < 3; ++k) {
    const double time = 100 + 5.0 / 30 - static_cast<double>(scene.mean_t[1]);
    EXPECT_NEAR(
        static_cast<double>(read.position[3 * order[1] + k]),
        static_cast<double>(scene.position[3 + k]) + static_cast<double>(slice.velocity[k]) * time,
        1e-3);
  }
}

TEST_F(FdgsOutTest, WhatLastsStaysStill) {
  Scene scene = seen_scene(3, 1);
  for (size_t i = 0; i < 3; ++i) {
    for (size_t k = 4; k < 8; ++k) scene.rotor[8 * i + k] = 0;
    scene.mean_t[i] = 102.5;
    scene.log_scale[4 * i + 3] = std::log(80.0F);
  }
  scene.placement.coordinate_system = L4D_COORDINATES_RIGHT_DOWN_FORWARD;
  scene.placement.color_space = L4D_COLOR_LINEAR_SRGB;
  scene.presentation.metres_per_unit = 0.5;
  scene.presentation.has_camera = 1;
  scene.presentation.camera_fov = 1.25;
  scene.presentation.camera_target[2] = 2;
  const Scene read = back(scene);
  EXPECT_FALSE(test::has_motion(read));
  EXPECT_EQ(read.mean_t, std::vector<float>(3, 2.5F));
  EXPECT_NEAR(read.log_scale[3], std::log(80.0F), 1e-6);
  EXPECT_EQ(read.placement.coordinate_system, scene.placement.coordinate_system);
  EXPECT_EQ(read.placement.color_space, scene.placement.color_space);
  EXPECT_EQ(read.presentation.metres_per_unit, 0.5);
  EXPECT_EQ(read.presentation.has_camera, 1U);
  EXPECT_NEAR(read.presentation.camera_fov, 1.25, 1e-12);
  EXPECT_EQ(read.presentation.camera_target[2], 2);
}

TEST_F(FdgsOutTest, LeavesOutWhatIsNeverSeen) {
  Scene scene = seen_scene(5, 0);
  scene.mean_t[2] = 90;
  scene.log_scale[4 * 2 + 3] = -3;
  for (size_t k = 4; k < 8; ++k) scene.rotor[8 * 2 + k] = 0;
  WriteNotes notes;
  EXPECT_EQ(back(scene, &notes).count(), 4U);
  EXPECT_EQ(notes["Gaussians that are not seen at any time of the sequence were left out"], 1U);
  scene.resize(0);
  EXPECT_EQ(back(scene).count(), 0U);
}

TEST_F(FdgsOutTest, TimesOfADayAndFarPositionsFit) {
  Scene scene = seen_scene(20, 0);
  scene.timeline = {0, 86400 * 30, 30, 1, 0};
  for (size_t i = 0; i < 20; ++i) {
    scene.mean_t[i] = static_cast<float>(4000 * i + 1);
    scene.log_scale[4 * i + 3] = -7;
  }
  scene.position[0] = 1e7F;
  const Scene read = back(scene);
  ASSERT_EQ(read.count(), 20U);
  const std::vector<size_t> order = by_opacity(read);
  EXPECT_NEAR(static_cast<double>(read.position[3 * order[0]]), 1e7, 1);
  for (size_t i = 0; i < 20; ++i) {
    EXPECT_NEAR(static_cast<double>(read.mean_t[order[i]]), static_cast<double>(4000 * i + 1),
                0.01);
  }
}

TEST_F(FdgsOutTest, NumbersThatAreNoneAreRefused) {
  Scene scene = seen_scene(3, 0);
  scene.position[4] = NAN;
  std::string message;
  EXPECT_EQ(test::status_of([&] { back(scene); }, &message), L4D_ERR_INVALID_SCENE);
  EXPECT_NE(message.find("Gaussian 1"), std::string::npos) << message;
  EXPECT_EQ(files_in_directory(), 0U);
}

}  // namespace
}  // namespace l4d::io
