// SPDX-License-Identifier: Apache-2.0
#include "training/footage/footage.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "io/file/file.h"
#include "tests/common/ffmpeg.h"
#include "training/footage/program.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// Four videos, and a program in place of COLMAP that has a model of them ready: what is tested is
// all but the search. tests/footage.sh has COLMAP itself.
class Footage : public testing::Test {
 protected:
  void SetUp() override {
    if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
    test::render_videos(folder_ / "footage");
    fs::remove(folder_ / "footage/cameras.json");
    fs::rename(folder_ / "footage/cam02.mp4", folder_ / "footage/phone.MOV");
    fs::create_directories(folder_ / "bin");
    std::ofstream(folder_ / "bin/colmap") << "#!/bin/sh\n"
                                             "[ \"$1\" = mapper ] || exit 0\n"
                                             "while [ \"$1\" != --output_path ]; do shift; done\n"
                                             "[ -e '"
                                          << folder_ / "model"
                                          << "' ] || { echo 'no good pair'; exit 1; }\n"
                                             "cp -r '"
                                          << folder_ / "model"
                                          << "' \"$2/0\"\n";
    fs::permissions(folder_ / "bin/colmap", fs::perms::owner_all);
    path_ = std::getenv("PATH");
    ::setenv("PATH", ((folder_ / "bin:") + path_).c_str(), 1);
  }
  void TearDown() override {
    if (!path_.empty()) ::setenv("PATH", path_.c_str(), 1);
  }
  void write_model(const std::vector<std::string>& images) {
    fs::create_directories(folder_ / "model");
    std::ofstream cameras(folder_ / "model/cameras.txt"), photos(folder_ / "model/images.txt");
    for (size_t k = 0; k < images.size(); ++k) {
      cameras << k + 1 << " SIMPLE_RADIAL 64 48 60 32 24 0.01\n";
      photos << k + 1 << " 1 0 0 0 " << 0.1 * static_cast<double>(k) << " 0 3 " << k + 1 << " "
             << images[k] << "\n\n";
    }
    std::ofstream(folder_ / "model/points3D.txt") << "1 0 0 1 255 0 0 0.5 1 0 2 0\n";
  }
  FootageReport make(const FootageOptions& options = {}) {
    return make_capture(
        folder_ / "footage", folder_ / "capture", options, [](const std::string&) {}, nullptr);
  }
  void expect_error(l4d_status status, const std::string& what,
                    const FootageOptions& options = {}) {
    try {
      make(options);
      ADD_FAILURE() << what;
    } catch (const io::Error& error) {
      EXPECT_EQ(error.status(), status);
      EXPECT_THAT(error.what(), HasSubstr(what));
    }
    EXPECT_FALSE(fs::exists(folder_ / "capture"));
    EXPECT_FALSE(fs::exists(folder_ / "capture.part"));
  }

  test::Folder folder_;
  std::string path_;
};

TEST_F(Footage, BecomesACapture) {
  EXPECT_TRUE(is_footage(folder_ / "footage"));
  EXPECT_FALSE(is_footage(folder_ / "bin"));
  write_model({"cam00.png", "cam01.png", "phone.png", "cam03.png"});
  const FootageReport report = make();
  EXPECT_EQ(report.cameras, 4U);
  EXPECT_NEAR(report.least_field, 56.14, 0.01);  // 64 pixels at a focal length of 60
  EXPECT_EQ(report.largest_field, report.least_field);
  EXPECT_EQ(report.clocks.cameras.size(), 4U);
  EXPECT_TRUE(report.notes.empty());
  const Capture capture = read_capture(folder_ / "capture", {});
  EXPECT_EQ(capture.frames, 12U);
  EXPECT_EQ(capture.fps, 10);
  EXPECT_EQ(capture.points.size(), 1U);
  for (size_t k = 0; k < 4; ++k) EXPECT_EQ(capture.cameras[k].split, k == 1 ? "test" : "train");
  EXPECT_EQ(fs::path(capture.cameras[3].source.video).filename(), "phone.MOV");
  EXPECT_EQ(capture.cameras[3].source.camera.fx, 60);
  EXPECT_EQ(capture.cameras[3].source.camera.world_to_camera[3], 0.2);
  EXPECT_EQ(capture.cameras[3].source.distortion.k[0], 0.01);
  try {
    make();
    ADD_FAILURE() << "it is there";
  } catch (const io::Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("replaces nothing"));
  }
}

TEST_F(Footage, CamerasWithoutAPlaceAreNamed) {
  write_model({"cam00.png", "cam01.png", "phone.png"});
  expect_error(L4D_ERR_CORRUPT, "these find no place beside the others: cam03.");
  FootageOptions options;
  options.tolerant = true;
  const FootageReport report = make(options);
  EXPECT_EQ(report.cameras, 3U);
  EXPECT_THAT(report.notes, testing::ElementsAre(HasSubstr("left out: cam03.")));
}

TEST_F(Footage, WhatFailsLeavesNothing) {
  expect_error(L4D_ERR_IO, "colmap mapper failed: no good pair");
  fs::copy_file(folder_ / "footage/cam00.mp4", folder_ / "footage/cam00.mkv");
  expect_error(L4D_ERR_INVALID_ARGUMENT, "two videos have the name cam00");
  fs::remove(folder_ / "footage/cam00.mkv");
  for (const char* name : {"cam00.mp4", "cam01.mp4"})
    fs::remove(folder_ / ("footage/" + std::string(name)));
  expect_error(L4D_ERR_INVALID_ARGUMENT, "it has 2 videos");
}

TEST(Programs, EndWhereTheyAreCancelled) {
  const test::Folder folder;
  const auto failure = [&](const std::vector<std::string>& words, bool cancelled) {
    try {
      run_program(words, folder / "log", "it is missing", [cancelled] { return cancelled; });
      return std::string();
    } catch (const io::Error& error) {
      return std::string(error.what());
    }
  };
  EXPECT_EQ(failure({"true"}, false), "");
  EXPECT_EQ(failure({"no-such-program"}, false), "it is missing");
  EXPECT_EQ(failure({"sh", "-c", "echo first; echo last; echo; exit 3"}, false),
            "sh -c failed: last");
  EXPECT_EQ(failure({"sleep", "1000"}, true), "cancelled");
}

}  // namespace
}  // namespace l4d::train
