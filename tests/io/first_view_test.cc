// SPDX-License-Identifier: Apache-2.0
#include "io/camera/first_view.h"

#include <cmath>

#include "io/camera/subject.h"
#include "tests/io/camera_files.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

double distance(const double* a, const Vec3& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

void set_stated_view(l4d_presentation* p, const Vec3& eye, const Vec3& target) {
  std::copy_n(eye.begin(), 3, p->camera_position);
  std::copy_n(target.begin(), 3, p->camera_target);
  p->camera_up[1] = -1;
  p->camera_fov = 0.8;
  p->has_camera = 1;
}

l4d_camera looking(const Vec3& eye, const Vec3& target) {
  l4d_presentation p = default_presentation();
  set_stated_view(&p, eye, target);
  return camera_of(p, 64, 48);
}

Vec3 eye_of(const l4d_camera& camera) {
  const double* m = camera.world_to_camera;
  Vec3 eye;
  for (size_t c = 0; c < 3; ++c) eye[c] = -(m[c] * m[3] + m[4 + c] * m[7] + m[8 + c] * m[11]);
  return eye;
}

// Adds `count` Gaussians in a ball, or on the walls of one.
void add_ball(Scene* scene, size_t count, const Vec3& center, double radius, double size,
              float opacity, bool is_hollow = false) {
  reference::Random random(scene->count() + 1);
  const size_t first = scene->count();
  scene->resize(first + count);
  for (size_t i = first; i < scene->count(); ++i) {
    Vec3 d;
    double r;
    do {
      for (double& x : d) x = random.uniform(-1, 1);
      r = std::hypot(d[0], d[1], d[2]);
    } while (r > 1 || r < 0.1);
    const double scale = is_hollow ? radius / r : radius;
    for (size_t k = 0; k < 3; ++k) {
      scene->position[3 * i + k] = static_cast<float>(center[k] + scale * d[k]);
      scene->log_scale[4 * i + k] = static_cast<float>(std::log(size));
    }
    scene->opacity[i] = opacity;
    scene->rotor[8 * i] = 1;
  }
}

Scene empty_scene() {
  Scene scene;
  set_fps(scene.timeline, 30);
  set_duration(scene.timeline, 1);
  return scene;
}

TEST(FirstView, IsThatOfTheCameraNearestToTheMiddle) {
  const Vec3 seen{1, 2, 9};
  std::vector<l4d_camera> cameras;
  for (const Vec3& eye : {Vec3{-4, 0, 0}, Vec3{0.5, 0.1, -1}, Vec3{5, 1, 0}, Vec3{0, -3, 1}}) {
    cameras.push_back(looking(eye, seen));
  }
  l4d_presentation p = default_presentation();
  p.playback = L4D_PLAYBACK_LOOP;
  state_first_view(cameras, 1, &p);
  ASSERT_EQ(p.has_camera, 1U);
  EXPECT_EQ(p.playback, static_cast<uint32_t>(L4D_PLAYBACK_LOOP));
  EXPECT_LT(distance(p.camera_position, {0.5, 0.1, -1}), 1e-9);
  // It looks at what all see.
  EXPECT_LT(distance(p.camera_target, seen), 0.05);
  EXPECT_NEAR(p.camera_fov, 0.8, 1e-9);
  // The camera that follows from it is the same one.
  const l4d_camera again = camera_of(p, 64, 48);
  for (size_t k = 0; k < 12; ++k) {
    EXPECT_NEAR(again.world_to_camera[k], cameras[1].world_to_camera[k], 1e-6);
  }
  EXPECT_NEAR(again.fy, cameras[1].fy, 1e-9);
}

TEST(FirstView, LooksAheadWhereAxesDoNotMeet) {
  // Side by side, all along z; and outwards from one place.
  std::vector<l4d_camera> row, outwards;
  for (const double x : {-2.0, 0.0, 2.0}) {
    row.push_back(looking({x, 0, 0}, {x, 0, 1}));
    outwards.push_back(looking({x, 0, 0.1}, {3 * x, 0, 4}));
  }
  for (const auto& cameras : {row, outwards}) {
    l4d_presentation p = default_presentation();
    state_first_view(cameras, 1, &p);
    EXPECT_LT(std::abs(p.camera_position[0]), 1e-9);
    EXPECT_GT(p.camera_target[2] - p.camera_position[2], 0.5);
  }
  l4d_presentation alone = default_presentation();
  state_first_view({looking({0, 0, 0}, {0, 0, 1})}, 7, &alone);
  EXPECT_NEAR(alone.camera_target[2], 7, 1e-9);
  l4d_presentation none = default_presentation();
  state_first_view(std::vector<l4d_camera>(), 7, &none);
  EXPECT_EQ(none.has_camera, 0U);
}

TEST(FirstView, OfCamerasIsOneThatTrains) {
  Scene scene = empty_scene();
  add_ball(&scene, 100, {0, 0, 5}, 1, 0.1, 0.9F);
  CameraSet set;
  for (const double x : {-1.0, 0.0, 1.5}) {
    Camera camera;
    camera.camera = looking({x, 0, 0}, {0, 0, 5});
    camera.split = x == 0 ? "test" : "train";
    set.cameras.push_back(camera);
  }
  l4d_presentation p = default_presentation();
  state_first_view(set, scene, &p);
  EXPECT_NEAR(std::abs(p.camera_position[0]), 1.0, 0.5 + 1e-9);
  EXPECT_NE(p.camera_position[0], 0);
}

// Training leaves haze before cameras, which they do not show; what stands further away they do.
TEST(FirstView, OfCamerasLooksPastTheHazeBeforeThem) {
  Scene scene = empty_scene();
  add_ball(&scene, 6000, {0, 0, 0}, 1, 0.03, 0.9F);
  add_ball(&scene, 100, {0, 0, -1.7}, 0.05, 0.03, 0.95F);
  add_ball(&scene, 200, {0.9, 0, 1.1}, 0.2, 0.05, 0.9F);
  CameraSet set;
  for (const Vec3& eye : {Vec3{0, 0, -1.8}, Vec3{1.5, 0, 1.8}}) {
    set.cameras.push_back({});
    set.cameras.back().camera = looking(eye, {0, 0, 0});
  }
  l4d_presentation p = default_presentation();
  state_first_view(set, scene, &p);
  EXPECT_NEAR(p.camera_position[2], -1.8, 1e-9);
}

// A dome of cameras: most look down at a bare floor, and the middle of all is nearest to those.
TEST(FirstView, OfADomeLooksAhead) {
  std::vector<l4d_camera> cameras;
  for (int k = 0; k < 12; ++k) {
    const double turn = 0.5 * k, height = k < 4 ? -1 : -4;
    const double out = k < 4 ? 5 : 1;
    cameras.push_back(
        looking({out * std::sin(turn), height, out * std::cos(turn)}, {0, k < 4 ? -1.0 : 0.0, 0}));
  }
  l4d_presentation p = default_presentation();
  state_first_view(cameras, 1, &p);
  EXPECT_NEAR(p.camera_position[1], -1, 1e-9);
  EXPECT_LT(p.camera_up[1], -0.99);
}

TEST(FirstView, IsUprightWhereACameraWasHeldAskew) {
  std::vector<l4d_camera> cameras;
  for (const double x : {-3.0, 3.0, 0.0}) {
    l4d_presentation p = default_presentation();
    p.camera_position[0] = x;
    p.camera_target[2] = 5;
    p.camera_up[x == 0 ? 0 : 1] = -1;
    p.camera_fov = 0.8;
    cameras.push_back(camera_of(p, 64, 48));
  }
  l4d_presentation p = default_presentation();
  state_first_view(cameras, 1, &p);
  EXPECT_EQ(p.camera_position[0], 0);
  EXPECT_LT(p.camera_up[1], -0.8);
}

// Up is away from what a scene stands on, whether the scene is tall or wide.
TEST(FirstView, TurnsAtItsDistanceAndStopsBeforeThePole) {
  l4d_presentation p = default_presentation();
  const Vec3 target{1, 2, 3};
  set_stated_view(&p, {1, 2 - 3.0, 3 - 4.0}, target);  // up is -y: 5 away, 3 above
  const auto height = [&](const l4d_presentation& view) { return 2 - view.camera_position[1]; };
  const l4d_presentation same = turned(p, 0);
  for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(same.camera_position[k], p.camera_position[k], 1e-12);
  for (const double angle : {0.0, 1.0, 3.0}) {
    EXPECT_NEAR(distance(turned(p, angle).camera_position, target), 5, 1e-12);
    EXPECT_NEAR(height(turned(p, angle)), 3, 1e-12);
    EXPECT_NEAR(height(turned(p, angle, -std::atan2(3, 4))), 0, 1e-12);
    EXPECT_NEAR(distance(turned(p, angle, 0.2, 4).camera_position, target), 5.0 / 4, 1e-12);
    EXPECT_NEAR(height(turned(p, angle, 9)), 5 * std::sin(1.5), 1e-12);
    EXPECT_NEAR(height(turned(p, angle, -9)), -5 * std::sin(1.5), 1e-12);
  }
}

TEST(Subject, StandsOnItsFoot) {
  const auto up_of = [](const Vec3& foot, double tall) {
    Scene scene = empty_scene();
    add_ball(&scene, 3000, {0, 0, 0}, 0.3, 0.03, 0.9F);
    for (size_t i = 0; i < scene.count(); ++i) {
      for (size_t k = 0; k < 3; ++k) {
        if (foot[k] != 0) scene.position[3 * i + k] *= static_cast<float>(tall);
      }
    }
    const size_t first = scene.count();
    add_ball(&scene, 1000, {0, 0, 0}, 0.5, 0.05, 0.9F);
    for (size_t i = first; i < scene.count(); ++i) {
      for (size_t k = 0; k < 3; ++k) {
        float& x = scene.position[3 * i + k];
        if (foot[k] != 0) x = static_cast<float>(foot[k] * 0.3 * tall) + 0.1F * x;
      }
    }
    return subject_of(scene).up;
  };
  for (const double tall : {0.6, 1.0, 5.0}) {
    EXPECT_EQ(up_of({0, 1, 0}, tall), (Vec3{0, -1, 0})) << tall;
    EXPECT_EQ(up_of({0, -1, 0}, tall), (Vec3{0, 1, 0})) << tall;
    EXPECT_EQ(up_of({0, 0, -1}, tall), (Vec3{0, 0, 1})) << tall;
  }
  Scene even = empty_scene();
  add_ball(&even, 3000, {0, 0, 0}, 1, 0.03, 0.9F);
  EXPECT_EQ(subject_of(even).up, (Vec3{0, -1, 0}));
  even.placement.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
  EXPECT_EQ(subject_of(even).up, (Vec3{0, 1, 0}));
}

TEST(Subject, LeavesOutFloatersAndHills) {
  Scene scene = empty_scene();
  add_ball(&scene, 6000, {2, 0, 1}, 1, 0.03, 0.9F);
  add_ball(&scene, 2000, {2, 0, 1}, 30, 0.5, 0.5F);       // floaters
  add_ball(&scene, 1500, {10, 0, 1}, 60, 2, 0.9F, true);  // hills
  const Subject subject = subject_of(scene);
  EXPECT_LT(distance(subject.center.data(), {2, 0, 1}), 0.2);
  EXPECT_NEAR(subject.radius, 0.95, 0.1);
}

// Of a room for five seconds: its walls, which stay.
constexpr size_t kWalls = 9000;
Scene room_with_someone() {
  Scene room = empty_scene();
  set_duration(room.timeline, 5);
  room.flags = L4D_POSITION_AT_MEAN_TIME;
  add_ball(&room, kWalls, {0, 0, 0}, 3, 0.1, 0.95F, true);
  add_ball(&room, 1500, {1, 0.5, 1}, 0.7, 0.03, 0.9F);
  for (size_t i = 0; i < room.count(); ++i) {
    room.mean_t[i] = 2.5F;
    room.log_scale[4 * i + 3] = i < kWalls ? 3.0F : -1.5F;
  }
  return room;
}

// Someone who moves in a room is what is looked at, and not the room.
TEST(Subject, IsWhereSomethingHappens) {
  Scene room = room_with_someone();
  const Subject subject = subject_of(room);
  EXPECT_LT(distance(subject.center.data(), {1, 0.5, 1}), 0.2);
  EXPECT_NEAR(subject.radius, 0.65, 0.1);
  EXPECT_GT(whole_subject_of(room).radius, 2);
  // Where all of it comes and goes, nothing stands out.
  for (size_t i = 0; i < kWalls; ++i) room.log_scale[4 * i + 3] = -1.5F;
  EXPECT_GT(subject_of(room).radius, 2);
}

// Someone whom each frame makes anew is one, however many Gaussians that takes.
TEST(Subject, CountsWhatFramesMakeAnewOnce) {
  Scene room = room_with_someone();
  const uint32_t frames = room.timeline.num_frames;
  for (uint32_t frame = 1; frame < frames; ++frame) {
    add_ball(&room, 1500, {1, 0.5, 1}, 0.7, 0.03, 0.9F);
  }
  room.mean_t.assign(room.count(), 2.5F);
  for (size_t i = 0; i < room.count(); ++i) {
    const uint32_t frame = i < kWalls ? 0 : static_cast<uint32_t>((i - kWalls) / 1500);
    room.log_scale[4 * i + 3] = 3;
    room.window.push_back(frame);
    room.window.push_back(i < kWalls ? frames : frame + 1);
  }
  EXPECT_LT(distance(subject_of(room).center.data(), {1, 0.5, 1}), 0.2);
  EXPECT_GT(whole_subject_of(room).radius, 2);
}

// The cameras would stand among the walls, and see what is before and behind them by chance.
TEST(OrbitCameras, GoAroundMoreThanWhatMoves) {
  for (const Camera& camera : orbit_cameras(room_with_someone(), 15, 64, 48).cameras) {
    EXPECT_GT(distance(eye_of(camera.camera).data(), {0, 0, 0}), 5);
  }
}

TEST(Subject, IsWhatTheSceneStates) {
  Scene scene = empty_scene();
  add_ball(&scene, 1000, {2, 0, 1}, 1, 0.03, 0.9F);
  l4d_presentation& p = scene.presentation;
  p.has_bounds = 1;
  const double low[3] = {0, 0, 0}, high[3] = {2, 4, 4};
  std::copy_n(low, 3, p.bounds_min);
  std::copy_n(high, 3, p.bounds_max);
  const Subject subject = subject_of(scene);
  EXPECT_EQ(subject.center, (Vec3{1, 2, 2}));
  EXPECT_EQ(subject.radius, 3);
}

// A ball within walls is seen from within the walls; one behind a wall from its open side.
TEST(FirstView, WithoutCamerasSeesTheDenseParts) {
  Scene room = empty_scene();
  add_ball(&room, 6000, {0, 0, 0}, 0.8, 0.03, 0.9F);
  add_ball(&room, 9000, {0, 0, 0}, 2, 0.1, 0.95F, true);
  l4d_presentation p = default_presentation();
  state_first_view(room, &p);
  ASSERT_EQ(p.has_camera, 1U);
  EXPECT_LT(distance(p.camera_position, {0, 0, 0}), 1.95);
  EXPECT_GT(distance(p.camera_position, {0, 0, 0}), 0.8);

  Scene wall = empty_scene();
  add_ball(&wall, 6000, {0, 0, 0}, 1, 0.03, 0.9F);
  const size_t first = wall.count();
  add_ball(&wall, 2000, {0, 0, 0}, 1.3, 0.1, 0.95F, true);
  for (size_t i = first; i < wall.count(); ++i) {  // the half of the shell towards +z
    float& z = wall.position[3 * i + 2];
    z = std::abs(z);
  }
  p = default_presentation();
  state_first_view(wall, &p);
  EXPECT_LT(p.camera_position[2], 0.5);

  Scene nothing = empty_scene();
  add_ball(&nothing, 10, {0, 0, 0}, 1, 0.03, 0);
  p = default_presentation();
  state_first_view(nothing, &p);
  EXPECT_EQ(p.has_camera, 0U);
}

// What is seen from within is circled within its walls, however near to them the stated view is.
TEST(OrbitCameras, StayWithinAPlace) {
  Scene room = empty_scene();
  add_ball(&room, 3000, {0, 0, 0}, 0.5, 0.03, 0.9F);
  add_ball(&room, 9000, {0, 0, 0}, 2, 0.1, 0.95F, true);
  for (size_t i = 3000; i < room.count(); ++i) room.position[3 * i] *= 0.6F;  // narrow along x
  const auto distances = [&](double from) {
    l4d_presentation& p = room.presentation;
    p = default_presentation();
    set_stated_view(&p, {0, 0, from}, {0, 0, 0});
    double least = 1e9, most = 0;
    for (const Camera& camera : orbit_cameras(room, 30, 64, 48).cameras) {
      const Vec3 eye = eye_of(camera.camera);
      const double inside = std::hypot(eye[0] / 0.6, eye[1], eye[2]);  // 2 on the walls
      least = std::min(least, distance(eye.data(), {0, 0, 0}));
      most = std::max(most, inside);
    }
    return std::pair(least, most);
  };
  for (const double from : {-1.8, 1.0}) {
    const auto [least, most] = distances(from);
    EXPECT_GT(least, 0.5) << from;
    EXPECT_LT(most, 1.95) << from;
  }
  EXPECT_GT(distances(-7).first, 2.5) << "an object";
}

}  // namespace
}  // namespace l4d::io
