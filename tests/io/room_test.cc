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

Scene room(uint64_t gaussians, const std::vector<std::string>& effects = {}, double seconds = 5,
           int threads = 0, uint64_t seed = 1) {
  return test::place("room", gaussians, effects, seconds, threads, seed);
}

Vec3 eye_of(const l4d_camera& camera) {  // -R^T t
  const double* m = camera.world_to_camera;
  Vec3 out;
  for (size_t k = 0; k < 3; ++k) out[k] = -(m[k] * m[3] + m[4 + k] * m[7] + m[8 + k] * m[11]);
  return out;
}

TEST(Room, BitsAreTheSameEverywhere) {
  EXPECT_EQ(hash(room(10000)), 16164735465575766041U);
  EXPECT_EQ(hash(room(3000, {"rigid", "deform", "flicker", "drops"}, 3600, 0, 7)),
            16895110801440873741U);
}

TEST(Room, BitsDependOnTheSeedAndNotOnThreads) {
  const uint64_t one = hash(room(5000, {}, 2, 1));
  EXPECT_EQ(one, hash(room(5000, {}, 2, 2)));
  EXPECT_NE(one, hash(room(5000, {}, 2, 1, 2)));
}

TEST(Room, HasExactlyAsManyGaussiansAsAskedFor) {
  for (const uint64_t n : {uint64_t{1}, uint64_t{1000}, uint64_t{10007}, uint64_t{20000}}) {
    EXPECT_EQ(room(n).count(), n);
  }
}

TEST(Room, EveryEffectAloneIsSound) {
  for (const char* effect : kPlaceEffects) {
    SCOPED_TRACE(effect);
    const std::string name = effect;
    const Scene scene = room(4000, {effect});
    expect_sound(scene);
    EXPECT_EQ(scene.count(), 4000U);
    EXPECT_EQ(scene.sh_degree, name == "view" ? 3U : 0U);
    EXPECT_EQ(scene.window.empty(), name != "frames");
    size_t moving = 0;
    for (size_t i = 0; i < scene.count(); ++i) moving += scene.rotor[8 * i + 4] != 0;
    if (name == "static" || name == "view") {
      EXPECT_EQ(moving, 0U);
    } else {
      EXPECT_GT(moving, 1000U);  // flames rise, too
    }
  }
}

// The whole of it is a closed box, and nothing but what is seen through the window lies outside.
TEST(Room, IsClosedAndLiesWithinItsBounds) {
  const Scene scene = room(30000, {"static", "rigid", "deform", "flicker"});
  const l4d_presentation& p = scene.presentation;
  ASSERT_EQ(p.has_bounds, 1U);
  size_t outside = 0;
  for (size_t i = 0; i < scene.count(); ++i) {
    const float* at = &scene.position[3 * i];
    bool within = true;
    for (size_t k = 0; k < 3; ++k) {
      within = within && at[k] > p.bounds_min[k] - 0.1 && at[k] < p.bounds_max[k] + 0.1;
    }
    outside += !within;
    EXPECT_TRUE(within || at[0] < p.bounds_min[0]) << i;  // to the west
  }
  EXPECT_GT(outside, 100U);
  EXPECT_LT(outside, scene.count() / 8);
}

// Rain is the fastest: metres per second.
TEST(Room, VelocitiesAreThoseOfThings) {
  const double fastest = test::fastest(room(20000, {"rigid", "deform", "flicker", "drops"}));
  EXPECT_GT(fastest, 5);
  EXPECT_LT(fastest, 8);
  EXPECT_LT(test::fastest(room(20000, {"rigid", "deform"})), 1.5);
}

TEST(Room, LastsFromASecondToADay) {
  for (const double seconds : {1.0, 3600.0, 86400.0}) {
    SCOPED_TRACE(seconds);
    const Scene scene = room(10000, {}, seconds);
    expect_sound(scene);
    EXPECT_EQ(scene.count(), 10000U);
    EXPECT_EQ(duration(scene.timeline), seconds);
  }
}

TEST(Room, CamerasStandInsideAndTheFirstIsTheFirstView) {
  const Scene scene = room(1000);
  ASSERT_EQ(scene.presentation.has_camera, 1U);
  const std::string path = ::testing::TempDir() + "l4d_room_cameras.json";
  write_place_cameras(path, "room", scene.timeline);
  const CameraSet set = read_cameras(path);
  EXPECT_EQ(set.cameras.size(), 8U + 24 + 150);
  EXPECT_EQ(set.frames, 150U);
  EXPECT_TRUE(set.notes.empty());
  size_t train = 0;
  for (const Camera& camera : set.cameras) {
    train += camera.split == "train";
    const Vec3 eye = eye_of(camera.camera);
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_GT(eye[k], scene.presentation.bounds_min[k] + 0.15) << camera.id;
      EXPECT_LT(eye[k], scene.presentation.bounds_max[k] - 0.15) << camera.id;
    }
  }
  EXPECT_EQ(train, 24U);
  EXPECT_EQ(set.cameras[0].id, 0);
  const Vec3 first = eye_of(set.cameras[0].camera);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(first[k], scene.presentation.camera_position[k], 1e-9);
  }
}

TEST(Room, RefusesWhatItHasNot) {
  EXPECT_EQ(test::status_of([] { room(100, {"appear"}); }), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(test::status_of([] { write_place_cameras("x.json", "cloud", {}); }),
            L4D_ERR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace l4d::io
