// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/camera/cameras.h"
#include "tests/io/camera_files.h"

namespace l4d::io {
namespace {

l4d_timeline timeline(double begin, uint32_t frames, uint32_t fps) {
  l4d_timeline t{};
  t.time_begin = begin;
  t.num_frames = frames;
  t.fps_num = fps;
  t.fps_den = 1;
  return t;
}

// Ids 10, 11, 12, ...; the first is for testing.
CameraSet still_cameras(size_t count) {
  CameraSet set;
  for (size_t i = 0; i < count; ++i) {
    Camera camera;
    camera.id = static_cast<int>(10 + i);
    camera.split = i == 0 ? "test" : "train";
    set.cameras.push_back(camera);
  }
  return set;
}

ViewSelection selection(const std::string& split, const std::string& ids,
                        const std::string& frames) {
  ViewSelection s;
  s.split = split;
  s.ids = ids;
  s.frames = frames;
  return s;
}

// "camera@frame" of each view.
std::string listed(const std::vector<View>& views) {
  std::string text;
  for (const View& view : views) {
    text +=
        (text.empty() ? "" : " ") + std::to_string(view.camera) + "@" + std::to_string(view.frame);
  }
  return text;
}

// ---- selection ----

TEST(SelectViews, ByFrameThenByCamera) {
  const std::vector<View> views = select_views(still_cameras(3), {}, timeline(2, 2, 10));
  EXPECT_EQ(listed(views), "0@0 1@0 2@0 0@1 1@1 2@1");
  EXPECT_DOUBLE_EQ(views[0].time, 2);
  EXPECT_DOUBLE_EQ(views[5].time, 2.1);
}

TEST(SelectViews, SplitIdsAndFrames) {
  const CameraSet set = still_cameras(6);
  const l4d_timeline t = timeline(0, 20, 10);
  const auto select = [&](const char* split, const char* ids, const char* frames) {
    return listed(select_views(set, selection(split, ids, frames), t));
  };
  EXPECT_EQ(select("test", "", "0:20:10"), "0@0 0@10");
  EXPECT_EQ(select("test", "", "0:11:10"), "0@0 0@10");
  EXPECT_EQ(select("test", "", "0:10:10"), "0@0");
  EXPECT_EQ(select("train", "", "19"), "1@19 2@19 3@19 4@19 5@19");
  EXPECT_EQ(select("all", "15,10", "3:5"), "0@3 5@3 0@4 5@4");
  EXPECT_EQ(select("all", "12-13,13,15", "0"), "2@0 3@0 5@0");
  EXPECT_EQ(select("train", "0-11", "0"), "1@0");
}

TEST(SelectViews, TextThatIsNone) {
  const CameraSet set = still_cameras(3);
  const auto status = [&](const ViewSelection& s) {
    return test::status_of([&] { select_views(set, s, timeline(0, 20, 10)); });
  };
  for (const char* ids : {"x", "10,", ",10", "10-", "-10", "12-10", "10-11-12", "13", "1e1",
                          "10 11", "99999999999", " 10"}) {
    EXPECT_EQ(status(selection("all", ids, "")), L4D_ERR_INVALID_ARGUMENT) << ids;
  }
  for (const char* frames : {"x", ":", "0:", ":5", "5:5", "6:5", "0:5:0", "0:5:", "0:5:1:1", "20",
                             "0:21", "-1", "0:5:-1", "4294967295", "4294967296"}) {
    EXPECT_EQ(status(selection("all", "", frames)), L4D_ERR_INVALID_ARGUMENT) << frames;
  }
  EXPECT_EQ(status(selection("none", "", "")), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(status(selection("val", "", "")), L4D_ERR_INVALID_ARGUMENT);        // no such camera
  EXPECT_EQ(status(selection("test", "11-12", "")), L4D_ERR_INVALID_ARGUMENT);  // none in both
}

TEST(SelectViews, FramesOfTheCamerasAndOfTheScene) {
  CameraSet set = still_cameras(1);
  set.fps = 30;
  set.frames = 150;
  // Two seconds of the five that the cameras recorded.
  std::vector<View> views = select_views(set, {}, timeline(1, 120, 60));
  ASSERT_EQ(views.size(), 60U);
  EXPECT_DOUBLE_EQ(views[59].time, 1 + 59 / 30.0);
  // A scene longer than the recording.
  views = select_views(set, {}, timeline(0, 300, 30));
  EXPECT_EQ(views.size(), 150U);
  // A rate whose product with the duration is whole but for rounding.
  l4d_timeline ntsc = timeline(0, 150, 30000);
  ntsc.fps_den = 1001;
  set.fps = 30000.0 / 1001;
  EXPECT_EQ(select_views(set, {}, ntsc).size(), 150U);
  set.frames = 1;  // a scene at rest
  EXPECT_EQ(listed(select_views(set, {}, timeline(0, 300, 30))), "0@0");
  EXPECT_EQ(test::status_of([&] { select_views(set, {}, timeline(0, 0, 30)); }),
            L4D_ERR_INVALID_ARGUMENT);
}

TEST(SelectViews, CamerasOfAnInstant) {
  CameraSet set = still_cameras(5);
  const double times[] = {1, 0, 0.52, 0.48, 0.5};
  for (size_t i = 0; i < 5; ++i) set.cameras[i].time = times[i];
  set.seconds = 2;
  const l4d_timeline t = timeline(10, 20, 10);  // two seconds
  const std::vector<View> views = select_views(set, {}, t);
  EXPECT_EQ(listed(views), "1@0 3@10 4@10 2@10 0@19");
  EXPECT_DOUBLE_EQ(views[1].time, 10.96);
  EXPECT_DOUBLE_EQ(views[4].time, 12);
  EXPECT_EQ(listed(select_views(set, selection("all", "", "10"), t)), "3@10 4@10 2@10");
  EXPECT_EQ(listed(select_views(set, selection("train", "", "0:20:19"), t)), "1@0");
  // As l4dtrain reads them: whatever the sequence lasts.
  set.seconds = 1;
  EXPECT_EQ(listed(select_views(set, {}, t)), "1@0 3@5 4@5 2@5 0@10") << "seconds since the begin";
  EXPECT_DOUBLE_EQ(select_views(set, {}, t)[1].time, 10.48);
  // What is later than the end is at the end, also where its seconds are no finite number.
  set.cameras[0].time = 1e300;
  set.seconds = 1e300;
  EXPECT_DOUBLE_EQ(select_views(set, selection("all", "10", ""), t)[0].time, 12);
}

// ---- orbits ----

// A cloud: +-4 in x and `depth` in y, +-`height` in z, around (1, 2, 3). What is flat in z is a
// ground: most of it is low.
Scene cloud(float depth, float height) {
  Scene scene;
  scene.timeline = timeline(0, 30, 30);
  scene.resize(1000);
  reference::Random random(5);
  for (size_t i = 0; i < scene.count(); ++i) {
    const float half[3] = {4, depth, height};
    for (size_t k = 0; k < 3; ++k) {
      float u = static_cast<float>(random.uniform(-1, 1));
      if (k == 2 && height < depth) u = 0.5F * (u + 1) * (u + 1) - 1;
      scene.position[3 * i + k] = static_cast<float>(k + 1) + half[k] * u;
    }
    scene.opacity[i] = 0.5F;
    scene.rotor[8 * i] = 1;
  }
  return scene;
}

TEST(OrbitCameras, SeeTheScene) {
  for (const bool is_tall : {false, true}) {
    Scene scene = is_tall ? cloud(0.5F, 3) : cloud(3, 0.5F);
    scene.position[0] = 1e6F;  // a stray, and two that no one sees
    scene.position[3] = NAN;
    scene.position[6] = -1e30F;
    scene.opacity[2] = 0;
    const CameraSet set = orbit_cameras(scene, 30, 320, 200);
    ASSERT_EQ(set.cameras.size(), 30U);
    EXPECT_EQ(set.source, "orbit");
    size_t above = 0;
    for (const Camera& camera : set.cameras) {
      const l4d_camera& c = camera.camera;
      EXPECT_NEAR(c.fy, 100 / std::tan(3.14159265358979 / 6), 1e-9);
      const double center[3] = {1, 2, 3};
      const test::Pixel middle = test::project(c, center);
      EXPECT_NEAR(middle.u, 160, 20);
      EXPECT_NEAR(middle.v, 100, 20);
      size_t seen = 0;
      for (size_t i = 3; i < scene.count(); ++i) {
        const double p[3] = {static_cast<double>(scene.position[3 * i]),
                             static_cast<double>(scene.position[3 * i + 1]),
                             static_cast<double>(scene.position[3 * i + 2])};
        const test::Pixel pixel = test::project(c, p);
        seen += pixel.depth > c.near_plane && pixel.u >= 0 && pixel.u < 320 && pixel.v >= 0 &&
                pixel.v < 200;
      }
      EXPECT_GE(seen, 890U);
      // The image stands upright: what is above, here -y or +z, is in its upper half.
      const double high[3] = {1, is_tall ? -1.0 : 2.0, is_tall ? 3.0 : 6.0};
      above += test::project(c, high).v < middle.v - 5;
    }
    EXPECT_EQ(above, 30U);
  }
}

TEST(OrbitCameras, RingsAndErrors) {
  const Scene scene = cloud(3, 0.5F);
  const auto heights = [&](uint32_t count) {  // of the cameras over the scene, in rings
    std::vector<int> rings(3);
    for (const Camera& camera : orbit_cameras(scene, count, 64, 64).cameras) {
      const double* m = camera.camera.world_to_camera;
      EXPECT_NEAR(m[2], 0, 1e-12);                               // level
      ++rings[static_cast<size_t>(1 - std::lround(2 * m[10]))];  // forward is -sin(elevation) in z
    }
    return rings;
  };
  EXPECT_EQ(heights(11), (std::vector<int>{0, 11, 0}));
  EXPECT_EQ(heights(13), (std::vector<int>{4, 5, 4}));
  const auto status = [&](const Scene& s, uint32_t count, uint32_t width) {
    return test::status_of([&] { orbit_cameras(s, count, width, 64); });
  };
  EXPECT_EQ(status(scene, 1, 64), L4D_OK);
  EXPECT_EQ(status(scene, 0, 64), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(status(scene, 100001, 64), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(status(scene, 1, 0), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(status(scene, 1, 16385), L4D_ERR_INVALID_ARGUMENT);
  Scene invisible = cloud(3, 0.5F);
  std::fill(invisible.opacity.begin(), invisible.opacity.end(), 0.0F);
  EXPECT_EQ(status(invisible, 1, 64), L4D_ERR_INVALID_SCENE);
}

TEST(OrbitCameras, FollowGaussiansIntoTheSequence) {
  Scene scene = cloud(3, 0.5F);
  for (size_t i = 0; i < scene.count(); ++i) {
    scene.mean_t[i] = -200;
    scene.rotor[8 * i + 4] = 0.5F;
    scene.log_scale[4 * i + 3] = 1;  // with the rotor: a velocity
  }
  const CameraSet expected = orbit_cameras(scene, 3, 64, 64);
  const float before = scene.position[0];
  positions_to_mean_time(scene);
  opacity_to_logit(scene);
  ASSERT_GT(std::abs(scene.position[0] - before), 50);
  const CameraSet same = orbit_cameras(scene, 3, 64, 64);
  for (size_t k = 0; k < 12; ++k) {
    EXPECT_NEAR(same.cameras[1].camera.world_to_camera[k],
                expected.cameras[1].camera.world_to_camera[k], 1e-3);
  }
}

}  // namespace
}  // namespace l4d::io
