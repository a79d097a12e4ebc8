// SPDX-License-Identifier: Apache-2.0
#include "io/camera/cameras.h"

#include <cmath>
#include <limits>

#include "io/image/image.h"
#include "tests/common/files.h"
#include "tests/io/camera_files.h"

namespace l4d::io {
namespace {

class CamerasTest : public test::IoTest {
 protected:
  l4d_status status(const std::string& name, const std::string& bytes, std::string* message) const {
    const std::string file = write(name, bytes);
    return test::status_of([&] { read_cameras(file); }, message);
  }
};

// ---- cameras.json ----

TEST_F(CamerasTest, JsonOfKAndW2c) {
  const CameraSet set = read_cameras(write("cameras.json", test::kCamerasJson));
  EXPECT_EQ(set.source, "cameras_json");
  EXPECT_EQ(set.fps, 25);
  EXPECT_EQ(set.frames, 50U);
  ASSERT_EQ(set.cameras.size(), 2U);
  const Camera& a = set.cameras[0];
  EXPECT_EQ(a.id, 7);
  EXPECT_EQ(a.split, "test");
  EXPECT_EQ(a.video, path("sub/a.mp4"));
  EXPECT_FALSE(a.time.has_value());
  EXPECT_EQ(a.camera.struct_size, sizeof(l4d_camera));
  EXPECT_EQ(a.camera.width, 640U);
  EXPECT_EQ(a.camera.height, 480U);
  EXPECT_EQ(a.camera.near_plane, 0.02);
  test::expect_pixel(a.camera, 300 + 500 * 0.4 / 4, 200 - 400 * 0.6 / 4);
  const Camera& b = set.cameras[1];
  EXPECT_EQ(b.id, 3);
  EXPECT_EQ(b.split, "");
  EXPECT_EQ(b.video, "");
  EXPECT_EQ(b.camera.width, 1280U);
  EXPECT_EQ(b.camera.height, 720U);
  EXPECT_EQ(b.camera.fx, 500.5);
  EXPECT_EQ(b.camera.world_to_camera[11], 3);
}

TEST_F(CamerasTest, JsonThatIsWrongIsNamed) {
  const struct {
    const char *from, *to, *message;
  } cases[] = {
      {"500, 0, 300", "1e999, 0, 300", "out_of_range"},
      {"500, 0, 300", "0, 0, 300", "camera 7: the focal length is 0;"},
      {"500, 0, 300", "-500, 0, 300", "camera 7: the focal length is -500;"},
      {"500, 0, 300", "500, 2, 300", "camera 7: K has a skew"},
      {"500, 0, 300", "500, 0", "camera 7: K must be a matrix of 3 x 3"},
      {"500, 0, 300", "500, 0, \"x\"", "camera 7: K is not a number"},
      {"[0, 0, 1]]", "[0, 0, 2]]", "camera 7: K is no matrix of a pinhole"},
      {"[0, 1, 0, 0]", "[0, 1.002, 0, 0]", "camera 7: the rotation is not orthonormal"},
      {"[0, 1, 0, 0]", "[0, 1, 0.002, 0]", "camera 7: the rotation is not orthonormal"},
      {"[0, 1, 0, 0]", "[0, -1, 0, 0]", "camera 7: the rotation contains a reflection"},
      {"[0, 1, 0, 0]", "[0, null, 0, 0]", "camera 7: w2c is not a number"},
      {"[0, 0, 0, 1]]", "[0, 0, 1, 1]]", "camera 7: w2c does not end in the row"},
      {"\"K\"", "\"k\"", "camera 7: K is missing"},
      {"\"id\": 3", "\"id\": 7", "camera 7: the id is there twice"},
      {"\"id\": 3", "\"id\": 1.5", "entry 1 of cameras: id is no whole number"},
      {"\"width\": 640", "\"width\": 16385", "camera 7: width is no whole number"},
      {"\"width\": 640", "\"width\": 0", "camera 7: an image of 0 x 480"},
      {"\"width\": 640,", "", "camera 7: width is missing"},
      {"\"test\"", "\"exam\"", "camera 7: split"},
      {"\"sub/a.mp4\"", "4", "camera 7: video is not a text"},
      {"\"frames\": 50", "\"frames\": -1", "frames is no whole number"},
      {"\"frames\": 50", "\"frames\": 16777217", "frames is no whole number from 0 to 16777216"},
      {"\"fps\": 25", "\"fps\": -25", "fps is not from 0 to 1000000"},
      {"\"cameras\"", "\"Cameras\"", "frames is not a list"},
      {"\"fps\": 25", "\"fps\": 24, \"fps\": 25", "an object has a key twice"},
      {"\"id\": 3", "\"id\": 5, \"id\": 3", "an object in cameras has a key twice"},
      {"500, 0, 300], [0, 400, 200]", "500, 0, 0.5], [0, 400, 0.5]",
       "camera 7: the principal point is (0.5, 0.5) of an image of 640 x 480"},
      {"500, 0, 300", "0.9, 0, 300", "camera 7: the focal length is 0.9 of an image"},
      {"\"cameras\": [", "\"cameras\": [5,", "entry 0 of cameras: not an object"},
  };
  for (const auto& c : cases) {
    std::string message;
    const l4d_status status =
        this->status("cameras.json", test::replaced(test::kCamerasJson, c.from, c.to), &message);
    EXPECT_TRUE(status == L4D_ERR_CORRUPT || status == L4D_ERR_FEATURE_UNSUPPORTED) << c.to;
    EXPECT_NE(message.find(c.message), std::string::npos) << c.to << ": " << message;
    EXPECT_EQ(message.find(path("cameras.json")), 0U) << message;
  }
}

TEST_F(CamerasTest, JsonOfLensesOffsetsAndImages) {
  const std::string text = R"({"width": 64, "height": 48, "cameras": [
    {"id": 0, "images": "a/%04d.png", "mask": "m.png", "time_offset": -0.004,
     "near": 0.75,
     "distortion": [0.1, -0.2, 0.003, 0.004, 0.05],
     "K": [[50, 0, 32], [0, 50, 24], [0, 0, 1]],
     "w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
    {"id": 1, "distortion_model": "fisheye", "distortion": [0.1, 0.2, 0.3, 0.4],
     "K": [[50, 0, 32], [0, 50, 24], [0, 0, 1]],
     "w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]})";
  const CameraSet set = read_cameras(write("cameras.json", text));
  ASSERT_EQ(set.cameras.size(), 2U);
  const Camera& a = set.cameras[0];
  EXPECT_EQ(a.images, path("a/%04d.png"));
  EXPECT_EQ(a.mask, path("m.png"));
  EXPECT_EQ(a.time_offset, -0.004);
  EXPECT_EQ(a.camera.near_plane, 0.75);
  EXPECT_EQ(set.cameras[1].camera.near_plane, 0.02);
  EXPECT_EQ(a.distortion.model, Distortion::Model::kRadial);
  EXPECT_EQ(a.distortion.k[1], -0.2);
  EXPECT_EQ(a.distortion.p[0], 0.003);
  EXPECT_EQ(a.distortion.k[2], 0.05);
  EXPECT_EQ(set.cameras[1].distortion.model, Distortion::Model::kFisheye);
  EXPECT_EQ(set.cameras[1].distortion.k[3], 0.4);
  const auto wrong = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    changed.replace(changed.find(from), from.size(), to);
    try {
      read_cameras(write("cameras.json", changed));
      FAIL() << to;
    } catch (const Error& error) {
      EXPECT_EQ(error.status(), L4D_ERR_CORRUPT) << to;
    }
  };
  // A fisheye lens needs no coefficients to be one.
  const std::string bare = test::replaced(text, ", \"distortion\": [0.1, 0.2, 0.3, 0.4]", "");
  EXPECT_EQ(read_cameras(write("cameras.json", bare)).cameras[1].distortion.model,
            Distortion::Model::kFisheye);
  wrong("[0.1, 0.2, 0.3, 0.4]", "[0.1, 0.2, 0.3, 0.4, 0.5]");
  wrong("[0.1, 0.2, 0.3, 0.4]", "[0.1, null]");
  wrong("fisheye", "fisheyes");
  wrong("-0.004", "null");
  wrong("0.75", "0");
  wrong("0.75", "\"far\"");
}

TEST_F(CamerasTest, NumbersAreInTheirRanges) {
  const auto text = [](const std::string& translation, const std::string& focal,
                       const std::string& more) {
    return R"({"width": 48, "height": 32, "cameras": [{"id": 7, "K": [[)" + focal +
           R"(, 0, 24], [0, 50, 16], [0, 0, 1]], "w2c": [[1, 0, 0, )" + translation +
           R"(], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]])" + more + "}]}";
  };
  std::string message;
  EXPECT_EQ(
      status("cameras.json", text("1e9", "1e8", R"(, "near": 1e9, "time_offset": -1e6)"), &message),
      L4D_OK)
      << message;
  const auto refused = [&](const std::string& changed, const std::string& what) {
    EXPECT_EQ(status("cameras.json", changed, &message), L4D_ERR_CORRUPT) << what;
    EXPECT_NE(message.find("camera 7: " + what), std::string::npos) << message;
  };
  refused(text("1e300", "50", ""), "the translation is 1e+300");
  refused(text("-1.1e9", "50", ""), "the translation is -1.1e+09");
  refused(text("0", "1e300", ""), "the focal length is 1e+300");
  refused(text("0", "1e-300", ""), "the focal length is 1e-300");
  refused(text("0", "50", R"(, "near": 1e300)"), "near is 1e+300");
  refused(text("0", "50", R"(, "near": 0)"), "near is 0");
  refused(text("0", "50", R"(, "time_offset": 1e300)"), "time_offset is 1e+300");
  refused(text("0", "50", R"(, "distortion": [1e30, 1e30, 1e30, 1e30])"), "distortion is 1e+30");
  refused(text("0", "50", R"(, "distortion": [0, 0, 1e30])"), "distortion is 1e+30");
  // JSON has no NaN: it and a number beyond the range of double are errors of the text.
  EXPECT_EQ(status("cameras.json", text("NaN", "50", ""), &message), L4D_ERR_CORRUPT);
  EXPECT_EQ(status("cameras.json", text("1e999", "50", ""), &message), L4D_ERR_CORRUPT);
}

TEST_F(CamerasTest, OneRuleOfPathsForAllThatACameraNames) {
  for (const char* key : {"video", "images", "mask"}) {
    for (const std::string name : {"/etc/passwd", "../secret.png", "a/../../secret.png"}) {
      const std::string text =
          R"({"width": 48, "height": 32, "cameras": [{"id": 7, "K": [[50, 0, 24], [0, 50, 16],
           [0, 0, 1]], "w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]], ")" +
          std::string(key) + "\": \"" + name + "\"}]}";
      const CameraSet set = read_cameras(write("set.json", text));
      std::string message;
      EXPECT_EQ(test::status_of([&] { require_inside(set, set.cameras[0]); }, &message),
                L4D_ERR_INVALID_ARGUMENT)
          << key << " " << name;
      EXPECT_NE(message.find("--any-path"), std::string::npos) << message;
      const CameraSet free = read_cameras(path("set.json"), true);
      EXPECT_NO_THROW(require_inside(free, free.cameras[0]));
    }
  }
}

TEST_F(CamerasTest, CountsWhatItReads) {
  const std::string file = write("cameras.json", test::kCamerasJson);
  const MemoryBudget small("--limit-memory", 1000), enough("--limit-memory", 1000000);
  EXPECT_EQ(test::status_of([&] { read_cameras(file, false, small.holder()); }),
            L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_EQ(small.held(), 0U);
  {
    const CameraSet set = read_cameras(file, false, enough.holder());
    EXPECT_GE(enough.held(), set.cameras.size() * sizeof(Camera));
  }
  EXPECT_EQ(enough.held(), 0U);
}

TEST_F(CamerasTest, TransformsOfADistortedLens) {
  const auto lens_with = [&](const std::string& keys) {
    std::string text = test::kTransforms;
    text.insert(1, keys);
    return read_cameras(write("transforms.json", text)).cameras[0].distortion;
  };
  Distortion lens = lens_with(R"("k1": 0.1, "p2": 0.01, )");
  EXPECT_EQ(lens.model, Distortion::Model::kRadial);
  EXPECT_EQ(lens.k[0], 0.1);
  EXPECT_EQ(lens.p[1], 0.01);
  lens = lens_with(R"("distortion_params": [0.1, 0.2, 0.3, 0, 0.01, 0.02], )");
  EXPECT_EQ(lens.k[0], 0.1);
  EXPECT_EQ(lens.k[2], 0.3);
  EXPECT_EQ(lens.p[1], 0.02);
  lens = lens_with(R"("k1": 0.1, "k4": 0.02, "k5": 0.03, "k6": 0.04, )");
  EXPECT_EQ(lens.model, Distortion::Model::kRadial);
  EXPECT_EQ(lens.k[5], 0.04);
  lens = lens_with(R"("camera_model": "FULL_OPENCV", "k4": 0.02, )");
  EXPECT_EQ(lens.k[3], 0.02);
  // A fisheye lens without coefficients is none the less no pinhole.
  for (const char* fisheye : {R"("camera_model": "OPENCV_FISHEYE", "k4": 0.02, )",
                              R"("camera_model": "OPENCV_FISHEYE", )", R"("is_fisheye": true, )"}) {
    EXPECT_EQ(lens_with(fisheye).model, Distortion::Model::kFisheye) << fisheye;
  }
  EXPECT_EQ(lens_with(R"("is_fisheye": false, "camera_model": "PINHOLE", )").model,
            Distortion::Model::kNone);
  std::string message;
  for (const char* model : {"EQUIRECTANGULAR", "ORTHOPHOTO", "VR180_L", "opencv"}) {
    std::string text = test::kTransforms;
    text.insert(1, std::string(R"("camera_model": ")") + model + "\", ");
    EXPECT_EQ(status("transforms.json", text, &message), L4D_ERR_FEATURE_UNSUPPORTED);
    EXPECT_NE(message.find(model), std::string::npos) << message;
  }
  for (const char* keys :
       {R"("latlong": true, )", R"("k4": 0.02, )", R"("distortion_params": [0, 0, 0, 1, 0, 0], )",
        R"("is_fisheye": true, "k5": 1, )"}) {
    std::string text = test::kTransforms;
    text.insert(1, keys);
    EXPECT_EQ(status("transforms.json", text, &message), L4D_ERR_FEATURE_UNSUPPORTED) << keys;
  }
}

TEST_F(CamerasTest, WhatTransformsSayBesidesIsNamed) {
  std::string text = test::kTransforms;
  text.insert(1, R"("applied_transform": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]],
    "applied_scale": 0.5, "orientation_override": "none", "aabb_scale": 16,
    "test_filenames": ["train/r_001.jpg"], )");
  const CameraSet set = read_cameras(write("transforms.json", text));
  ASSERT_EQ(set.notes.size(), 3U);
  EXPECT_NE(set.notes[0].find("orientation_override"), std::string::npos) << set.notes[0];
  EXPECT_NE(set.notes[1].find("applied_transform"), std::string::npos) << set.notes[1];
  EXPECT_NE(set.notes[2].find("applied_scale"), std::string::npos) << set.notes[2];
  EXPECT_EQ(set.cameras[0].split, "");
  EXPECT_EQ(set.cameras[1].split, "test");
}

TEST_F(CamerasTest, ListsOfImagesThatDoNotFitAreNamed) {
  std::string text = test::kTransforms;
  text.insert(1, R"("train_filenames": ["train/r_000"], "test_filenames": ["r_001.jpg"], )");
  const CameraSet set = read_cameras(write("transforms.json", text));
  EXPECT_EQ(set.cameras[0].split, "train");
  ASSERT_EQ(set.notes.size(), 2U);
  EXPECT_NE(set.notes[0].find("that no frame has: r_001.jpg."), std::string::npos) << set.notes[0];
  EXPECT_NE(set.notes[1].find("tests has: 1."), std::string::npos) << set.notes[1];
}

TEST_F(CamerasTest, TransformsHaveMasksAndPoints) {
  std::string text = test::replaced(test::kTransforms, R"("file_path": "train/r_001.jpg")",
                                    R"("mask_path": "m/1.png", "file_path": "train/r_001.jpg")");
  text.insert(1, R"("ply_file_path": "sparse_pc.ply", )");
  CameraSet set = read_cameras(write("transforms.json", text));
  EXPECT_EQ(set.cameras[0].mask, "");
  EXPECT_EQ(set.cameras[1].mask, path("m/1.png"));
  EXPECT_EQ(set.points, "");
  ASSERT_EQ(set.notes.size(), 1U);
  EXPECT_NE(set.notes[0].find("sparse_pc.ply are not there"), std::string::npos) << set.notes[0];
  write("sparse_pc.ply", "");
  EXPECT_EQ(read_cameras(path("transforms.json")).points, path("sparse_pc.ply"));
  text = test::replaced(text, "sparse_pc.ply", "../sparse_pc.ply");
  set = read_cameras(write("transforms.json", test::replaced(text, "m/1.png", "../1.png")));
  EXPECT_EQ(set.points, "");
  EXPECT_FALSE(set.cameras[1].outside.empty());
}

TEST_F(CamerasTest, TransformsFindNamesWithDots) {
  std::string text = test::replaced(test::kTransforms, "./train/r_000", "./train/r_0.5");
  text = test::replaced(text, "train/r_001.jpg", "train/\xd0\xba 1");
  std::filesystem::create_directory(path("train"));
  write_png(path("train/r_0.5.png"), Image(64, 48));
  write("train/\xd0\xba 1.jpg", "");
  const CameraSet set = read_cameras(write("transforms.json", text));
  EXPECT_EQ(set.cameras[0].image, path("train/r_0.5.png"));
  EXPECT_EQ(set.cameras[1].image, path("train/\xd0\xba 1.jpg"));
}

TEST_F(CamerasTest, TransformsTakeSizesOfJpegs) {
  const std::string text =
      test::replaced(test::kTransforms, "\"w\": 640, \"h\": 480,", "\"fl_x\": 500, ");
  std::filesystem::create_directory(path("train"));
  // SOI, a segment of 6 bytes, SOF2: precision, height, width, ...
  const std::string jpeg("\xff\xd8\xff\xe0\x00\x04\x01\x02\xff\xc2\x00\x0b\x08\x01\x40\x02\x80\x01",
                         18);
  write("train/r_000.jpg", jpeg);
  write("train/r_001.jpg", jpeg);
  const CameraSet set = read_cameras(write("transforms.json", text));
  EXPECT_EQ(set.cameras[0].camera.width, 640U);
  EXPECT_EQ(set.cameras[0].camera.height, 320U);
  EXPECT_EQ(set.cameras[0].camera.fx, 500);
  EXPECT_TRUE(set.notes.empty()) << set.notes[0];  // its angle is that of the focal length
  // A focal length in pixels of how many?
  std::string message;
  write("train/r_001.jpg", jpeg.substr(0, 14));
  EXPECT_EQ(status("transforms.json", text, &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("camera 1: the focal length is in pixels"), std::string::npos) << message;
}

TEST_F(CamerasTest, TruncatedAndForeignFiles) {
  std::string message;
  for (size_t size = 0; size < test::kCamerasJson.size(); size += 7) {
    EXPECT_EQ(status("cameras.json", test::kCamerasJson.substr(0, size), &message), L4D_ERR_CORRUPT)
        << size;
  }
  for (const char* text : {"[]", "3", "{}", "{\"cameras\": []}", "{\"cameras\": {}}",
                           "{\"frames\": []}", "{\"frames\": [1], \"camera_angle_x\": 1}"}) {
    EXPECT_EQ(status("cameras.json", text, &message), L4D_ERR_CORRUPT) << text;
  }
  // Depth alone must not exhaust the stack.
  EXPECT_EQ(status("cameras.json", std::string(1000000, '['), &message), L4D_ERR_CORRUPT);
  EXPECT_EQ(test::status_of([&] { read_cameras(path("absent.json")); }), L4D_ERR_IO);
}

TEST_F(CamerasTest, Basketball) {
  const std::string file = l4d::test::data_file("basketball/cameras.json");
  if (file.empty()) GTEST_SKIP() << "no data set";
  const CameraSet set = read_cameras(file);
  EXPECT_EQ(set.fps, 30);
  EXPECT_EQ(set.frames, 150U);
  ASSERT_EQ(set.cameras.size(), 31U);
  std::vector<int> test_ids;
  for (const Camera& camera : set.cameras) {
    if (camera.split == "test") test_ids.push_back(camera.id);
    EXPECT_EQ(camera.camera.width, 640U);
    EXPECT_EQ(camera.camera.height, 360U);
    EXPECT_TRUE(std::filesystem::exists(camera.video)) << camera.video;
  }
  EXPECT_EQ(test_ids, (std::vector<int>{0, 10, 15, 30}));
}

// ---- transforms.json ----

TEST_F(CamerasTest, TransformsOfBlender) {
  const CameraSet set = read_cameras(write("transforms_train.json", test::kTransforms));
  EXPECT_EQ(set.source, "transforms");
  EXPECT_EQ(set.seconds, 1) << "the file does not say";
  EXPECT_EQ(set.fps, 0);
  EXPECT_EQ(set.frames, 0U);
  ASSERT_EQ(set.cameras.size(), 2U);
  const Camera& a = set.cameras[0];
  EXPECT_NEAR(a.camera.fx, 500, 1e-9);
  EXPECT_EQ(a.camera.fy, a.camera.fx);
  test::expect_pixel(a.camera, 320 + 500 * 0.4 / 4, 240 - 500 * 0.6 / 4);
  EXPECT_EQ(a.split, "train");
  EXPECT_EQ(a.image, path("train/r_000.png"));
  EXPECT_EQ(a.time.value_or(-1), 0.25);
  EXPECT_EQ(set.cameras[1].image, path("train/r_001.jpg"));
  EXPECT_EQ(set.cameras[1].id, 1);
}

TEST_F(CamerasTest, TransformsWithIntrinsicsPerFileAndFrame) {
  std::string text = test::replaced(test::kTransforms, "\"w\": 640, \"h\": 480,",
                                    "\"w\": 640, \"h\": 480, \"fl_x\": 600, \"fl_y\": 610, "
                                    "\"cx\": 310, \"cy\": 250, \"k1\": 0.01,");
  text = test::replaced(text, "\"time\": 1.0", "\"time\": 2.5, \"fl_x\": 900, \"w\": 100");
  const CameraSet set = read_cameras(write("transforms_val.json", text));
  test::expect_pixel(set.cameras[0].camera, 310 + 600 * 0.4 / 4, 250 - 610 * 0.6 / 4);
  EXPECT_EQ(set.cameras[1].camera.fx, 900);
  EXPECT_EQ(set.cameras[1].camera.width, 100U);
  EXPECT_EQ(set.cameras[1].camera.height, 480U);
  EXPECT_EQ(set.cameras[0].split, "val");
  EXPECT_EQ(set.cameras[1].time.value_or(-1), 2.5);
  ASSERT_EQ(set.notes.size(), 1U);
  EXPECT_NE(set.notes[0].find("camera_angle differs from"), std::string::npos) << set.notes[0];
  const std::vector<std::string> notes = notes_of_pinholes(set);
  ASSERT_EQ(notes.size(), 2U);
  EXPECT_NE(notes[1].find("lens distorts, which is left out: 2;"), std::string::npos) << notes[1];
}

TEST_F(CamerasTest, TransformsTakeSizesFromImages) {
  const std::string text = test::replaced(test::kTransforms, "\"w\": 640, \"h\": 480,", "");
  std::filesystem::create_directory(path("train"));
  write_png(path("train/r_000.png"), Image(320, 200));
  const CameraSet set = read_cameras(write("transforms.json", text));
  EXPECT_EQ(set.cameras[0].camera.width, 320U);
  EXPECT_EQ(set.cameras[0].camera.height, 200U);
  EXPECT_EQ(set.cameras[0].camera.cx, 160);
  EXPECT_NEAR(set.cameras[0].camera.fx, 250, 1e-9);  // the angle is that of the width
  EXPECT_EQ(set.cameras[1].camera.width, 800U);
  EXPECT_EQ(set.cameras[0].split, "");
  ASSERT_EQ(set.notes.size(), 1U);
  EXPECT_NE(set.notes[0].find("1 cameras"), std::string::npos) << set.notes[0];
}

TEST_F(CamerasTest, TransformsThatAreWrongAreNamed) {
  const struct {
    const char *from, *to, *message;
  } cases[] = {
      {"\"time\": 0.25,", "", "all cameras or none must have a time"},
      {"0.25", "-0.25", "camera 0: time is not from 0 to 1e9"},
      {"1.1386263822013238", "3.5", "camera 0: camera_angle_x is no angle"},
      {"camera_angle_x", "angle", "camera 0: neither fl_x nor"},
      {"\"h\": 480,", "", "camera 0: h is missing"},
      {"[0, 0, 1, 5]", "[0, 0, 1.1, 5]", "camera 0: the rotation is not orthonormal"},
      {"[0, 0, 1, 5]", "[0, 0, -1, 5]", "camera 0: the rotation contains a reflection"},
      {"transform_matrix", "matrix", "camera 0: transform_matrix is missing"},
  };
  for (const auto& c : cases) {
    std::string message;
    EXPECT_EQ(status("transforms.json", test::replaced(test::kTransforms, c.from, c.to), &message),
              L4D_ERR_CORRUPT)
        << c.to;
    EXPECT_NE(message.find(c.message), std::string::npos) << c.to << ": " << message;
  }
}

// ---- poses_bounds.npy ----

TEST_F(CamerasTest, PosesBounds) {
  const std::string f8 = "{'descr': '<f8', 'fortran_order': False, 'shape': (3, 17), }";
  const std::string f4 = "{\"shape\": (3,17), 'fortran_order':False,'descr':'<f4'}   ";
  for (const std::string& bytes :
       {test::npy_header(f8) + test::npy_rows<double>(test::kLlffRow, 3),
        test::npy_header(f8, 2) + test::npy_rows<double>(test::kLlffRow, 3),
        test::npy_header(f4) + test::npy_rows<float>(test::kLlffRow, 3)}) {
    const CameraSet set = read_cameras(write("poses_bounds.npy", bytes));
    EXPECT_EQ(set.source, "poses_bounds");
    ASSERT_EQ(set.cameras.size(), 3U);
    EXPECT_EQ(set.cameras[0].split, "test");
    EXPECT_EQ(set.cameras[2].split, "train");
    EXPECT_EQ(set.cameras[2].id, 2);
    EXPECT_EQ(set.cameras[0].camera.width, 640U);
    EXPECT_EQ(set.cameras[0].camera.height, 480U);
    EXPECT_EQ(set.cameras[0].video, "");
    test::expect_pixel(set.cameras[1].camera, 320 + 500 * 0.4 / 4, 240 - 500 * 0.6 / 4);
    EXPECT_EQ(set.notes.size(), 3U);
  }
  std::vector<double> near_behind_far = test::kLlffRow, on_the_camera = test::kLlffRow;
  std::swap(near_behind_far[15], near_behind_far[16]);
  on_the_camera[15] = 0;
  const CameraSet odd = read_cameras(
      write("odd.npy", test::npy_header(f8) + test::npy_rows<double>(test::kLlffRow, 1) +
                           test::npy_rows<double>(near_behind_far, 1) +
                           test::npy_rows<double>(on_the_camera, 1)));
  ASSERT_EQ(odd.notes.size(), 4U);
  EXPECT_EQ(odd.notes[0],
            "Cameras whose bounds of depth are no range above 0: 2; those of camera 1 are 100 and "
            "1. Bounds are not used.");
  for (const char* name : {"cam10.mp4", "cam02.mp4", "cam00.mp4"}) write(name, "");
  EXPECT_EQ(read_cameras(path("poses_bounds.npy")).cameras[2].video, path("cam10.mp4"));
}

TEST_F(CamerasTest, PosesBoundsThatAreWrong) {
  const std::string good = "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 17), }";
  const std::string rows = test::npy_rows<double>(test::kLlffRow, 2);
  std::string message;
  const auto with = [&](const char* from, const char* to) {
    return status("p.npy", test::npy_header(test::replaced(good, from, to)) + rows, &message);
  };
  ASSERT_EQ(status("p.npy", test::npy_header(good) + rows, &message), L4D_OK);
  EXPECT_EQ(with("<f8", "<f4"), L4D_ERR_CORRUPT);
  EXPECT_EQ(with("<f8", ">f8"), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(with("False", "True"), L4D_ERR_FEATURE_UNSUPPORTED);
  for (const char* shape :
       {"(2, 16)", "(34,)", "()", "(3, 17)", "(1, 17)", "(4611686018427387904, 17)",
        "(99999999999999999999999, 17)", "(2, 17", "2, 17)", "(-2, 17)"}) {
    EXPECT_EQ(with("(2, 17)", shape), L4D_ERR_CORRUPT) << shape;
  }
  EXPECT_EQ(with("'shape'", "'form'"), L4D_ERR_CORRUPT);
  EXPECT_EQ(with("'descr': '<f8', ", ""), L4D_ERR_CORRUPT);
  EXPECT_EQ(with("}", ""), L4D_ERR_CORRUPT);

  const std::string whole = test::npy_header(good) + rows;
  for (size_t size = 0; size < whole.size(); size += 3) {
    EXPECT_EQ(status("p.npy", whole.substr(0, size), &message), L4D_ERR_CORRUPT) << size;
  }
  EXPECT_EQ(status("p.npy", whole + "x", &message), L4D_ERR_CORRUPT);
  std::string huge = test::npy_header(good, 2) + rows;
  huge.replace(8, 4, "\xff\xff\xff\xff");
  EXPECT_EQ(status("p.npy", huge, &message), L4D_ERR_CORRUPT);
  EXPECT_EQ(status("p.npy", test::npy_header(good, 3) + rows, &message),
            L4D_ERR_FEATURE_UNSUPPORTED);

  const struct {
    size_t at;
    double value;
  } numbers[] = {{3, NAN}, {4, 480.5}, {9, 0},
                 {9, 1e9}, {14, 0},    {14, -5},
                 {2, 1.1}, {2, -1},    {7, std::numeric_limits<double>::infinity()}};
  for (const auto& n : numbers) {
    std::vector<double> row = test::kLlffRow;
    row[n.at] = n.value;
    EXPECT_EQ(status("p.npy",
                     test::npy_header(good) + test::npy_rows<double>(test::kLlffRow, 1) +
                         test::npy_rows<double>(row, 1),
                     &message),
              L4D_ERR_CORRUPT)
        << n.at << " " << n.value;
    EXPECT_NE(message.find("camera 1: "), std::string::npos) << message;
  }
}

}  // namespace
}  // namespace l4d::io
