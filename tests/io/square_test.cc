// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/camera/cameras.h"
#include "io/synth/synth.h"
#include "tests/io/place_support.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using test::expect_sound;
using test::hash;

Scene square(uint64_t gaussians, const std::vector<std::string>& effects = {}, double seconds = 5,
             int threads = 0, uint64_t seed = 1) {
  return test::place("square", gaussians, effects, seconds, threads, seed);
}

TEST(Square, BitsAreTheSameEverywhere) {
  EXPECT_EQ(hash(square(10000)), 11243992606158507915U);
  EXPECT_EQ(hash(square(3000, {"rigid", "deform", "flicker", "drops"}, 3600, 0, 7)),
            16105446346387448031U);
}

TEST(Square, BitsDependOnTheSeedAndNotOnThreads) {
  const uint64_t one = hash(square(5000, {}, 2, 1));
  EXPECT_EQ(one, hash(square(5000, {}, 2, 2)));
  EXPECT_NE(one, hash(square(5000, {}, 2, 1, 2)));
}

TEST(Square, HasExactlyAsManyGaussiansAsAskedFor) {
  for (const uint64_t n : {uint64_t{1}, uint64_t{1000}, uint64_t{10007}, uint64_t{20000}}) {
    EXPECT_EQ(square(n).count(), n);
  }
}

TEST(Square, EveryEffectAloneIsSound) {
  for (const char* effect : kPlaceEffects) {
    SCOPED_TRACE(effect);
    const Scene scene = square(4000, {effect});
    expect_sound(scene);
    EXPECT_EQ(scene.count(), 4000U);
    EXPECT_EQ(scene.sh_degree, std::string(effect) == "view" ? 3U : 0U);
    EXPECT_EQ(scene.window.empty(), std::string(effect) != "frames");
    size_t moving = 0;
    for (size_t i = 0; i < scene.count(); ++i) moving += scene.rotor[8 * i + 4] != 0;
    const bool moves = std::string(effect) == "rigid" || std::string(effect) == "deform" ||
                       std::string(effect) == "drops" || std::string(effect) == "frames";
    EXPECT_EQ(moving > 1000, moves) << moving;
    if (!moves) {
      EXPECT_EQ(moving, 0U);
    }
  }
}

// Drops and balls are the fastest: metres per second.
TEST(Square, VelocitiesAreThoseOfThings) {
  const Scene scene = square(20000, {"rigid", "deform", "drops"});
  const double fastest = test::fastest(scene);
  EXPECT_GT(fastest, 3);  // drops and balls
  EXPECT_LT(fastest, 8);
}

TEST(Square, LastsFromASecondToADay) {
  for (const double seconds : {1.0, 3600.0, 86400.0}) {
    SCOPED_TRACE(seconds);
    const Scene scene = square(10000, {}, seconds);
    expect_sound(scene);
    EXPECT_EQ(scene.count(), 10000U);
    EXPECT_EQ(duration(scene.timeline), seconds);
  }
}

TEST(Square, StatesItsFirstViewWhichIsTheFirstCamera) {
  const Scene scene = square(1000);
  ASSERT_EQ(scene.presentation.has_camera, 1U);
  ASSERT_EQ(scene.presentation.has_bounds, 1U);
  const std::string path = ::testing::TempDir() + "l4d_square_cameras.json";
  write_place_cameras(path, "square", scene.timeline);
  const CameraSet set = read_cameras(path);
  EXPECT_EQ(set.cameras.size(), 8U + 24 + 150);
  EXPECT_EQ(set.frames, 150U);
  EXPECT_TRUE(set.notes.empty());
  size_t train = 0;
  for (const Camera& camera : set.cameras) train += camera.split == "train";
  EXPECT_EQ(train, 24U);
  // The eye of camera 0, -R^T t, is that of the first view.
  const l4d_camera& first = set.cameras[0].camera;
  EXPECT_EQ(set.cameras[0].id, 0);
  for (size_t k = 0; k < 3; ++k) {
    const double* m = first.world_to_camera;
    EXPECT_NEAR(-(m[k] * m[3] + m[4 + k] * m[7] + m[8 + k] * m[11]),
                scene.presentation.camera_position[k], 1e-9);
  }
  EXPECT_EQ(first.fx, first.fy);
  EXPECT_NEAR(540 / 2 / std::tan(scene.presentation.camera_fov / 2), first.fy, 1e-3);
}

TEST(Square, RefusesWhatItHasNot) {
  EXPECT_EQ(test::status_of([] { square(100, {"appear"}); }), L4D_ERR_INVALID_ARGUMENT);
  SynthOptions options;
  options.scene = "street";
  EXPECT_EQ(test::status_of([&] { synthesize(options); }), L4D_ERR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace l4d::io
