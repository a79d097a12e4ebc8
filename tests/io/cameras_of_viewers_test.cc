// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include "tests/io/camera_files.h"

// The list that 3DGS writes for its viewers, and the path that nerfstudio's viewer exports.
namespace l4d::io {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class CamerasOfViewersTest : public test::IoTest {
 protected:
  CameraSet read(const std::string& text) const { return read_cameras(write("c.json", text)); }
  void expect_refused(const std::string& text, const std::string& what) const {
    std::string message;
    EXPECT_EQ(test::status_of([&] { read(text); }, &message), L4D_ERR_CORRUPT) << what;
    EXPECT_THAT(message, HasSubstr(path("c.json") + ": " + what));
  }
};

// ---- the list of 3DGS ----

// An entry of the list, which begins with `keys`. Right, down and forward are the columns of the
// rotation.
std::string entry(const std::string& keys) {
  return "{" + keys + R"("img_name": "a", "width": 640, "height": 480, "position": [5, 0, 0],
   "rotation": [[0, 0, -1], [1, 0, 0], [0, -1, 0]], "fy": 400, "fx": 500})";
}
std::string list(const std::string& a, const std::string& b, const std::string& c) {
  return "[" + entry(a) + ", " + entry(b) + ", " + entry(c) + "]";
}
std::vector<int> ids_of(const CameraSet& set) {
  std::vector<int> ids;
  for (const Camera& camera : set.cameras) ids.push_back(camera.id);
  return ids;
}

TEST_F(CamerasOfViewersTest, ListOf3dgs) {
  const std::string text = "[" + entry(R"("id": 7, )") + "]";
  const CameraSet set = read(text);
  EXPECT_EQ(set.source, "3dgs_cameras");
  EXPECT_EQ(set.frames, 0U);  // cameras at rest, for any instant
  EXPECT_THAT(set.notes, ElementsAre());
  ASSERT_EQ(set.cameras.size(), 1U);
  test::expect_pixel(set.cameras[0].camera, 320 + 500 * 0.4 / 4, 240 - 400 * 0.6 / 4);
  expect_refused(test::replaced(text, "[5, 0, 0]", "[5, 0]"),
                 "camera 7: position is not a list of 3 numbers");
  expect_refused("[5]", "entry 0: not an object");
}

TEST_F(CamerasOfViewersTest, ListOf3dgsKeepsItsNumbers) {
  EXPECT_THAT(ids_of(read(list(R"("id": 7, )", R"("id": 3, )", R"("id": 0, )"))),
              ElementsAre(7, 3, 0));
  EXPECT_THAT(ids_of(read(list("", "", ""))), ElementsAre(0, 1, 2));
  const CameraSet some = read(list(R"("id": 7, )", "", R"("id": 7, )"));
  EXPECT_THAT(ids_of(some), ElementsAre(0, 1, 2));
  EXPECT_THAT(some.notes, ElementsAre(HasSubstr("entry 1 has no id")));
  expect_refused(list(R"("id": 7, )", R"("id": 3, )", R"("id": 7, )"),
                 "camera 7: the id is there twice");
  expect_refused(list(R"("id": 7, )", R"("id": "b", )", R"("id": 1, )"),
                 "entry 1: id is not a number");
}

TEST_F(CamerasOfViewersTest, ListOf3dgsWithPrincipalPoints) {
  const auto with = [](const std::string& keys) {
    return "[" + entry(R"("id": 7, )" + keys) + "]";
  };
  test::expect_pixel(read(with(R"("cx": 300, "cy": 200, )")).cameras[0].camera, 300 + 500 * 0.4 / 4,
                     200 - 400 * 0.6 / 4);
  expect_refused(with(R"("cx": 300, )"), "camera 7: cy is missing");
  expect_refused(with(R"("cx": 0.5, "cy": 0.5, )"), "camera 7: the principal point is (0.5, 0.5)");
  // Offsets from the middle, as some programs write them.
  expect_refused(with(R"("cx": 0, "cy": 0, )"), "camera 7: cx is 0;");
  expect_refused(with(R"("cx": 300, "cy": -0.01, )"), "camera 7: cy is -0.01;");
  expect_refused(with(R"("cx": 640, "cy": 200, )"), "camera 7: cx is 640;");
}

TEST_F(CamerasOfViewersTest, WhatTheListOf3dgsSaysBesidesIsNamed) {
  EXPECT_THAT(read(list(R"("id": 7, )", R"("id": 3, "fid": 0.5, "time": 1, )",
                        R"("id": 0, "fid": 0.75, "timestamp": 1, )"))
                  .notes,
              ElementsAre("The key \"fid\" of camera 3 is not known, and is ignored.",
                          "The key \"time\" of camera 3 is not known, and is ignored.",
                          "The key \"timestamp\" of camera 0 is not known, and is ignored."));
}

// ---- the path of nerfstudio ----

const std::string kPath = R"({"camera_type": "perspective", "render_width": 640,
 "render_height": 480, "fps": 24, "seconds": 4, "smoothness_value": 0.5, "is_cycle": false,
 "keyframes": [], "crop": null, "camera_path": [
  {"camera_to_world": [0, 0, 1, 5, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1], "fov": 90,
   "aspect": 1.3333}]})";

TEST_F(CamerasOfViewersTest, PathOfNerfstudio) {
  const CameraSet set = read(kPath);
  EXPECT_EQ(set.source, "camera_path");
  EXPECT_EQ(set.fps, 24);
  EXPECT_THAT(set.notes, ElementsAre());
  ASSERT_EQ(set.cameras.size(), 1U);
  test::expect_pixel(set.cameras[0].camera, 320 + 240 * 0.4 / 4, 240 - 240 * 0.6 / 4);
  expect_refused(test::replaced(kPath, "0, 0, 0, 1]", "0, 0, 1, 1]"),
                 "entry 0 of camera_path: camera_to_world does not end in the row");
  expect_refused(test::replaced(kPath, "1.3333", "null"),
                 "entry 0 of camera_path: aspect is not a number");
  expect_refused(R"({"camera_path": [5], "render_width": 640, "render_height": 480})",
                 "entry 0 of camera_path: not an object");
}

TEST_F(CamerasOfViewersTest, WhatAPathSaysBesidesIsNamed) {
  std::string text = test::replaced(kPath, "\"fov\": 90", "\"fov\": 90, \"render_time\": 0.5");
  text = test::replaced(text, "\"crop\": null", "\"crop\": {\"crop_scale\": [1, 1, 1]}, \"x\": 1");
  EXPECT_THAT(
      read(text).notes,
      ElementsAre(
          "The key \"crop\" of the file is not known, and is ignored.",
          "The key \"x\" of the file is not known, and is ignored.",
          "The key \"render_time\" of entry 0 of camera_path is not known, and is ignored."));
  EXPECT_THAT(
      read(test::replaced(kPath, "1.3333", "1.7778")).notes,
      ElementsAre("Cameras whose aspect differs from render_width / render_height, which is "
                  "taken: 1."));
}

}  // namespace
}  // namespace l4d::io
