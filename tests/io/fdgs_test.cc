// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/formats/scene_file.h"
#include "tests/io/fdgs_file.h"

namespace l4d::io {
namespace {

using test::fdgs_file;
using test::FdgsParts;

class FdgsTest : public test::IoTest {
 protected:
  Scene read(const std::string& bytes, const ImportOptions& options = {}) {
    const std::string file = write("a.4dgs", bytes);
    return read_scene_file(file, file, options);
  }
  l4d_status status_of(const std::string& bytes, std::string* message = nullptr) {
    return test::status_of([&] { read(bytes); }, message);
  }
  static bool has_note(const Scene& scene, const std::string& words) {
    for (const std::string& note : scene.notes) {
      if (note.find(words) != std::string::npos) return true;
    }
    return false;
  }
};

void expect_the_three(const Scene& scene, uint32_t degree) {
  ASSERT_EQ(scene.count(), 3U);
  EXPECT_EQ(scene.source, "4dgs");
  EXPECT_EQ(scene.sh_degree, degree);
  EXPECT_EQ(scene.flags, L4D_POSITION_AT_MEAN_TIME);
  EXPECT_EQ(scene.timeline.num_frames, 120U);
  // A Gaussian that fades: sigma is exp(0). It is there for 2 sigma to each side, so its velocity
  // has steps of 0.5 / 4, and its time, a twentieth of sigma at most, steps of 0.25 / 8.
  EXPECT_EQ(scene.mean_t[0], 2);
  const float position[9] = {2, 4, 2, 1.5F, 2, 3, 1, 2, 3};
  for (size_t k = 0; k < 9; ++k) EXPECT_EQ(scene.position[k], position[k]) << k;
  const test::ReferenceSlice slice = test::reference_slice(scene, 0);
  const double velocity[3] = {1, -0.5, 0};
  const double covariance[6] = {1, 0, 0, std::exp(-2.0), 0, std::exp(2.0)};
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(static_cast<double>(slice.velocity[k]), velocity[k], 1e-6);
  }
  for (size_t k = 0; k < 6; ++k) {
    EXPECT_NEAR(static_cast<double>(slice.covariance[k]), covariance[k], 1e-5) << k;
  }
  EXPECT_NEAR(static_cast<double>(slice.sigma_t), 1, 1e-6);
  // Colours of 0.5, 0.25 and 0.
  const size_t numbers = 3 * scene.sh_coefficients();
  constexpr double kConstant = 0.28209479177387814;
  EXPECT_NEAR(scene.sh[0], 0, 1e-6);
  EXPECT_NEAR(scene.sh[1], -0.25 / kConstant, 1e-6);
  EXPECT_NEAR(scene.sh[2], -0.5 / kConstant, 1e-6);
  EXPECT_EQ(scene.opacity, (std::vector<float>{0.75F, 1, 1})) << "9/8 is limited";
  // A window of a second, at whose begin the Gaussian is at 1: half a second on, with a velocity in
  // steps of 0.5 / 2.
  EXPECT_EQ(scene.window, (std::vector<uint32_t>{0, 0, 30, 60, 0, 0}));
  EXPECT_EQ(scene.mean_t[1], 1.5F);
  EXPECT_NEAR(static_cast<double>(test::reference_slice(scene, 1).velocity[0]), 1, 1e-6);
  // One that lasts, turned by 60 degrees around x.
  EXPECT_EQ(scene.mean_t[2], 2);
  EXPECT_NEAR(scene.log_scale[4 * 2 + 3], std::log(64.0), 1e-6);
  EXPECT_EQ(scene.log_scale[4 * 2], 0.25F);
  EXPECT_NEAR(scene.rotor[8 * 2], std::sqrt(0.75), 1e-6);
  EXPECT_NEAR(scene.rotor[8 * 2 + 3], -0.5, 1e-6);
  for (size_t i = 0; i < 3; ++i) {
    for (uint32_t band = 1; band <= degree; ++band) {
      for (uint32_t c = 0; c < 3; ++c) {
        for (uint32_t k = 0; k < 2 * band + 1; ++k) {
          EXPECT_NEAR(scene.sh[numbers * i + 3 * (band * band + k) + c],
                      -4 + (70 * c + 10 * band + k) * 8 / 255.0, 1e-6);
        }
      }
    }
  }
}

TEST_F(FdgsTest, AllEncodingsAndDegreesAreRead) {
  for (const std::string compression : {"", "zstd", "deflate"}) {
    for (int codec = 0; codec <= 1; ++codec) {
      for (int mode = 0; mode <= 2; ++mode) {
        for (const int width : {1, 2, 4}) {
          FdgsParts parts;
          parts.compression = compression;
          parts.codec = codec;
          parts.mode = mode;
          parts.width = width;
          parts.degree = static_cast<uint32_t>(mode + 1);
          SCOPED_TRACE(compression + std::to_string(100 * codec + 10 * mode + width));
          expect_the_three(read(fdgs_file(parts)), parts.degree);
        }
      }
    }
  }
  expect_the_three(read(fdgs_file({})), 0);
}

TEST_F(FdgsTest, RotationsLeaveOutOneNumber) {
  const Scene scene = read(fdgs_file({}));
  // x = sqrt(1 - 3/4): a turn by 120 degrees around (1, 1, 1), which leaves a ball as it is.
  const test::ReferenceSlice slice = test::reference_slice(scene, 1);
  for (const size_t k : {0U, 3U, 5U})
    EXPECT_NEAR(static_cast<double>(slice.covariance[k]), 1, 1e-6);
}

TEST_F(FdgsTest, WhatTheFileStatesOfItselfIsKept) {
  FdgsParts parts;
  parts.attributes = {{"color_space", "linear-rec709-display"}, {"frame_rate", "30000/1001"}};
  std::string frame = test::fdgs_text("") + std::string("\x01\x04\x02\x02", 4);
  test::append(frame, 0.01);
  std::string camera;
  for (const double x : {45.0, 1.0, 2.0, 3.0, 1.0, 2.0, 8.0}) test::append(camera, x);
  test::append(camera, uint32_t{1});
  parts.more = test::fdgs_record(0x20, frame) + test::fdgs_record(0x09, "") +
               test::fdgs_record(0x0a, camera) + test::fdgs_record(0x85, "");
  const Scene scene = read(fdgs_file(parts));
  EXPECT_EQ(scene.timeline.fps_num, 30000U);
  EXPECT_EQ(scene.timeline.fps_den, 1001U);
  EXPECT_EQ(scene.placement.color_space, static_cast<uint32_t>(L4D_COLOR_LINEAR_SRGB));
  EXPECT_EQ(scene.placement.coordinate_system,
            static_cast<uint32_t>(L4D_COORDINATES_RIGHT_DOWN_FORWARD));
  EXPECT_EQ(scene.presentation.metres_per_unit, 0.01);
  ASSERT_EQ(scene.presentation.has_camera, 1U);
  EXPECT_NEAR(scene.presentation.camera_fov, std::atan(1.0), 1e-12);
  EXPECT_EQ(scene.presentation.camera_position[2], 3);
  EXPECT_EQ(scene.presentation.camera_target[2], 8);
  EXPECT_EQ(scene.presentation.camera_up[1], -1) << "y is down";
  EXPECT_TRUE(has_note(scene, "sound"));
  EXPECT_TRUE(has_note(scene, "camera path"));
  EXPECT_TRUE(has_note(scene, "records of kind 133"));

  parts = {};
  parts.attributes = {{"coordinate_system", "y-up-right-handed"}, {"frame_rate", "many"}};
  const Scene other = read(fdgs_file(parts));
  EXPECT_EQ(other.placement.coordinate_system,
            static_cast<uint32_t>(L4D_COORDINATES_RIGHT_UP_BACK));
  EXPECT_TRUE(has_note(other, "30 frames per second were assumed"));
}

TEST_F(FdgsTest, StaticFilesHaveNoDuration) {
  FdgsParts parts;
  parts.seconds = 0;
  parts.windows = {{0, HUGE_VAL}, {0, HUGE_VAL}};
  ImportOptions options;
  options.seconds = 3;
  options.fps = 20;
  const Scene scene = read(fdgs_file(parts), options);
  ASSERT_EQ(scene.count(), 3U);
  EXPECT_EQ(scene.timeline.num_frames, 60U);
  EXPECT_TRUE(scene.window.empty());
  EXPECT_EQ(scene.mean_t[2], 1.5F);
  EXPECT_NEAR(scene.log_scale[4 * 2 + 3], std::log(48.0), 1e-6);
  // It is at 1 after a second, with a velocity of 0.5: the window lasts for 2 seconds and more.
  EXPECT_NEAR(scene.position[3], 1.25, 1e-6);
}

TEST_F(FdgsTest, WindowsDecideTheFrameRate) {
  FdgsParts parts;
  parts.windows[1] = {0.04, 0.2};
  const Scene scene = read(fdgs_file(parts));
  EXPECT_EQ(scene.timeline.fps_num, 25U);
  EXPECT_EQ(scene.window[2], 1U);
  EXPECT_EQ(scene.window[3], 5U);
  ImportOptions options;
  options.fps = 10;
  const Scene coarse = read(fdgs_file(parts), options);
  EXPECT_EQ(coarse.window[2], 0U);
  EXPECT_EQ(coarse.window[3], 2U);
  EXPECT_TRUE(has_note(coarse, "Windows of 1 Gaussians were rounded to frames, by up to 0.04"));
}

TEST_F(FdgsTest, WindowsThatShowNothingOrEndAFadeAreNamed) {
  FdgsParts parts;
  parts.windows[1] = {5, 6};
  Scene scene = read(fdgs_file(parts));
  EXPECT_EQ(scene.count(), 2U);
  EXPECT_TRUE(scene.window.empty());
  EXPECT_TRUE(has_note(scene, "1 Gaussians whose windows show no frame were left out"));
  parts.windows = {};  // is a window of no length
  parts.second_window = {0};
  scene = read(fdgs_file(parts));
  EXPECT_EQ(scene.count(), 0U);
  parts.windows = {{0, 3}, {0, 4}};
  scene = read(fdgs_file(parts));
  // exp(-1/2) of an opacity of 0.75, a sigma behind the mean time.
  EXPECT_TRUE(has_note(scene, "1 Gaussians fade on")) << scene.notes.back();
  EXPECT_TRUE(has_note(scene, "up to 0.455 there")) << scene.notes.back();
}

TEST_F(FdgsTest, WhatIsNotReadIsNamed) {
  const auto refusal = [&](const FdgsParts& parts) {
    std::string message;
    EXPECT_EQ(status_of(fdgs_file(parts), &message), L4D_ERR_FEATURE_UNSUPPORTED) << message;
    return message;
  };
  FdgsParts parts;
  parts.model = "keyframe-delta";
  EXPECT_NE(refusal(parts).find("temporal model 'keyframe-delta'"), std::string::npos);
  parts = {};
  parts.scheme = "vectors";
  EXPECT_NE(refusal(parts).find("quantization 'vectors'"), std::string::npos);
  parts = {};
  parts.compression = "brotli";
  EXPECT_NE(refusal(parts).find("compression 'brotli'"), std::string::npos);
  parts = {};
  parts.codec = 2;
  EXPECT_NE(refusal(parts).find("codec 2"), std::string::npos);
  parts = {};
  parts.degree = 4;
  EXPECT_NE(refusal(parts).find("degree 4"), std::string::npos);
  parts = {};
  parts.objects = true;
  EXPECT_EQ(status_of(fdgs_file(parts)), L4D_OK);
  std::string track;
  test::append(track, uint32_t{7});
  track += '\0';
  test::append(track, uint32_t{1});
  parts.more = test::fdgs_record(0x25, track);
  EXPECT_NE(refusal(parts).find("object 7"), std::string::npos);
  std::string message, file = fdgs_file({});
  file[5] = '2';
  EXPECT_EQ(status_of(file, &message), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_NE(message.find("version 2 of .4dgs"), std::string::npos);
}

TEST_F(FdgsTest, WhatDoesNotFitTogetherIsRefused) {
  const auto refusal = [&](const FdgsParts& parts) {
    std::string message;
    EXPECT_EQ(status_of(fdgs_file(parts), &message), L4D_ERR_CORRUPT) << message;
    return message;
  };
  FdgsParts parts;
  parts.second_window = {2};
  EXPECT_NE(refusal(parts).find("window 2 of a Gaussian; there are 2"), std::string::npos);
  parts = {};
  parts.extra_count = 1;
  EXPECT_NE(refusal(parts).find("have 3 Gaussians"), std::string::npos);
  parts = {};
  parts.cutoff = 2;
  EXPECT_NE(refusal(parts).find("cutoff"), std::string::npos);
  parts = {};
  std::string frame = test::fdgs_text("") + std::string("\x01\x01\x04\x01", 4);
  test::append(frame, 1.0);
  parts.more = test::fdgs_record(0x20, frame);
  EXPECT_NE(refusal(parts).find("one axis"), std::string::npos);
  parts = {};
  parts.more = test::fdgs_chunk({}, 4'000'000, std::string(1000, 'x'));
  EXPECT_NE(refusal(parts).find("1000 bytes promises 4000000 Gaussians"), std::string::npos);
  std::string message, file = fdgs_file({});
  file[file.size() - 12] = static_cast<char>(file[file.size() - 12] ^ 1);
  EXPECT_EQ(status_of(file, &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("checksum"), std::string::npos) << message;
  EXPECT_EQ(status_of(fdgs_file({}) + "x"), L4D_ERR_CORRUPT);
}

TEST_F(FdgsTest, TruncationsAndChangedBytesDoNoHarm) {
  FdgsParts parts;
  parts.degree = 1;
  for (int kind = 0; kind < 3; ++kind) {
    parts.mode = kind;
    parts.codec = kind == 2 ? 1 : 0;
    parts.compression = kind == 1 ? "zstd" : "";
    const std::string whole = fdgs_file(parts);
    for (size_t size = 1; size < whole.size(); ++size) {
      ASSERT_EQ(status_of(whole.substr(0, size)), L4D_ERR_CORRUPT) << kind << " " << size;
    }
    for (size_t at = 8; at < whole.size(); ++at) {
      constexpr int kChanges[] = {1, 128, 255};
      std::string bytes = whole;
      bytes[at] = static_cast<char>(bytes[at] ^ kChanges[(at + static_cast<size_t>(kind)) % 3]);
      const l4d_status status = status_of(bytes);
      ASSERT_TRUE(status == L4D_OK || status == L4D_ERR_CORRUPT ||
                  status == L4D_ERR_FEATURE_UNSUPPORTED)
          << at << " " << status;
    }
  }
}

TEST_F(FdgsTest, CountsItsGaussians) {
  const std::string bytes = fdgs_file({});
  for (const uint64_t room : {uint64_t{1000}, bytes.size() + 100, bytes.size() + 500}) {
    const MemoryBudget budget("limit", room);
    ImportOptions options;
    options.holder = budget.holder();
    EXPECT_EQ(test::status_of([&] { read(bytes, options); }), L4D_ERR_LIMIT_EXCEEDED) << room;
    EXPECT_EQ(budget.held(), 0U);
  }
}

}  // namespace
}  // namespace l4d::io
