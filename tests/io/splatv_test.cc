// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstdio>

#include "io/formats/scene_file.h"
#include "tests/io/stg_file.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

constexpr uint16_t kNan = 0x7e00, kInfinity = 0x7c00;
constexpr size_t kTextureRow = 4096 * 16;  // bytes, 1024 Gaussians
constexpr const char* kEye =
    R"({"id": 0, "position": [1, 2, -7], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],)"
    R"( "fx": 500, "fy": 400, "width": 800, "height": 800})";

class SplatvTest : public test::IoTest {
 protected:
  using Row = test::StgRow;

  // Binary16 of a number that it represents.
  static uint16_t half(double value) {
    if (value == 0) return 0;
    int exponent = 0;
    const double fraction = std::frexp(std::abs(value), &exponent);  // 0.5 to 1
    const auto bits = static_cast<uint16_t>((2 * fraction - 1) * 1024);
    return static_cast<uint16_t>((value < 0 ? 0x8000 : 0) | (exponent + 14) << 10 | bits);
  }
  // The 64 bytes of a Gaussian.
  static std::string packed(const Row& row) {
    std::string bytes;
    const auto put = [&](const double* values, size_t n) {
      for (size_t k = 0; k < n; ++k) test::append(bytes, half(values[k]));
    };
    const double zero = 0, width = std::exp(row.log_width);
    for (const double x : row.position) test::append(bytes, static_cast<float>(x));
    put(row.wxyz, 4);
    for (const double s : row.scale) {
      const double scale = std::exp(s);
      put(&scale, 1);
    }
    put(&zero, 1);
    for (const double c : row.color) bytes += static_cast<char>(std::lround(255 * c));
    bytes += static_cast<char>(std::lround(255 / (1 + std::exp(-row.opacity))));
    put(row.motion, 9);
    put(&zero, 1);
    put(row.omega, 4);
    put(&row.center, 1);
    put(&width, 1);
    return bytes;
  }
  // Whose numbers binary16 and bytes represent.
  static Row exact_row() {
    Row row;
    row.log_width = std::log(0.25);
    row.opacity = std::log(204.0 / 51);
    for (int k = 0; k < 3; ++k) row.color[k] = 51 * (k + 1) / 255.0;
    for (int k = 0; k < 3; ++k) row.scale[k] = std::log(std::ldexp(1, -3 - k));
    return row;
  }
  static std::string list_of(const std::string& text) {
    std::string bytes;
    test::append(bytes, uint32_t{0x674b});
    test::append(bytes, static_cast<uint32_t>(text.size()));
    return bytes + text;
  }
  static std::string entry(size_t size, size_t height, const std::string& cameras = "") {
    return R"({"type": "splat", "size": )" + std::to_string(size) +
           R"(, "texwidth": 4096, "texheight": )" + std::to_string(height) +
           (cameras.empty() ? "" : R"(, "cameras": )" + cameras) + "}";
  }
  // A texture of one row, filled up with zeros.
  static std::string file_of(const std::string& rows, const std::string& cameras = "") {
    std::string texture = rows;
    texture.resize(kTextureRow, '\0');
    return list_of("[" + entry(kTextureRow, 1, cameras) + "]") + texture;
  }
  static ImportOptions two_seconds(const Hold& holder = {}) {
    ImportOptions options;
    options.seconds = 2;
    options.fps = 10;
    options.holder = holder;
    return options;
  }
  Scene read(const std::string& bytes, const Hold& holder = {}) {
    const std::string file = write("model", bytes);  // known by its content alone
    return read_scene_file(file, file, two_seconds(holder));
  }
  l4d_status status_of(const std::string& bytes, std::string* message = nullptr) {
    return test::status_of([&] { read(bytes); }, message);
  }
};

TEST_F(SplatvTest, IsTheSceneOfThePly) {
  Row still = exact_row(), straight = exact_row(), curved = exact_row();
  straight.motion[0] = 2;
  straight.motion[2] = -0.75;
  straight.center = -0.25;
  straight.wxyz[1] = 0.5;
  curved.position[1] = -40.5;
  for (int k = 0; k < 9; ++k) curved.motion[k] = (k - 4) / 8.0;
  for (int k = 0; k < 4; ++k) curved.omega[k] = 0.25 * k;
  const std::vector<Row> rows = {still, straight, curved};
  std::string bytes;
  for (const Row& row : rows) bytes += packed(row);
  const Scene scene = read(file_of(bytes));
  const std::string ply = write("same.ply", test::stg_ply(rows));
  const Scene same = read_scene_file(ply, ply, two_seconds());

  EXPECT_EQ(scene.source, "splatv");
  EXPECT_EQ(scene.flags, L4D_POSITION_AT_MEAN_TIME);
  ASSERT_EQ(scene.count(), rows.size());
  EXPECT_EQ(scene.timeline.num_frames, 20U);
  EXPECT_EQ(scene.mean_t, same.mean_t);
  const auto expect_near = [](const std::vector<float>& a, const std::vector<float>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (size_t k = 0; k < a.size(); ++k) {
      EXPECT_NEAR(a[k], b[k], 2e-6 * (1 + std::abs(b[k]))) << k;
    }
  };
  expect_near(scene.position, same.position);
  expect_near(scene.log_scale, same.log_scale);
  expect_near(scene.rotor, same.rotor);
  expect_near(scene.sh, same.sh);
  expect_near(scene.opacity, {0.8F, 0.8F, 0.8F});
  EXPECT_EQ(scene.notes, same.notes);
  ASSERT_EQ(scene.notes.size(), 3U);
}

TEST_F(SplatvTest, NumbersAtTheEndsOfTheirRange) {
  const auto changed = [](size_t at, uint16_t bits) {
    std::string bytes = packed(exact_row());
    std::memcpy(&bytes[at], &bits, 2);
    return bytes;
  };
  // Flat; never fading; never seen; then what is no number.
  const Scene scene =
      read(file_of(changed(22, 0) + changed(62, kInfinity) + changed(62, 0) + changed(62, kNan) +
                   changed(12, kInfinity) + changed(34, kNan) + changed(24, kInfinity)));
  ASSERT_EQ(scene.count(), 6U);
  EXPECT_EQ(scene.log_scale[1], -16);
  EXPECT_NEAR(scene.log_scale[4 + 3], std::log(32.0), 1e-6) << "16 times two seconds";
  for (size_t i = 2; i < 6; ++i) EXPECT_TRUE(std::isnan(scene.log_scale[4 * i + 3])) << i;
  ASSERT_EQ(scene.notes.size(), 2U);
  EXPECT_EQ(scene.notes[0], "Gaussians with a scale below e^-16, which was raised to that: 1.");
  EXPECT_EQ(scene.notes[1].rfind("1 Gaussian is never seen", 0), 0U);
  EXPECT_EQ(read(file_of("")).count(), 0U);
}

TEST_F(SplatvTest, TheFirstCameraThatSeesTheSceneIsTheFirstView) {
  const std::string rows = packed(exact_row());
  const std::string eye = kEye;
  const Scene scene = read(file_of(rows, "[" + eye + "]"));
  EXPECT_TRUE(scene.notes.empty());
  const l4d_presentation& p = scene.presentation;
  ASSERT_EQ(p.has_camera, 1U);
  const double position[] = {1, 2, -7}, target[] = {1, 2, 3}, up[] = {0, -1, 0};
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(p.camera_position[k], position[k]);
    EXPECT_EQ(p.camera_target[k], target[k]);
    EXPECT_EQ(p.camera_up[k], up[k]);
  }
  EXPECT_NEAR(p.camera_fov, 2 * std::atan(1), 1e-12);

  const Scene two = read(file_of(rows, "[" + eye + ", " + eye + "]"));
  EXPECT_EQ(two.presentation.has_camera, 1U);
  EXPECT_EQ(two.notes, std::vector<std::string>{"Of 2 cameras the first became the first view; "
                                                "others were not read."});
  // From behind, from aside, and what is no camera.
  const auto with = [&](const char* from, const char* to) {
    std::string text = eye;
    return text.replace(text.find(from), std::strlen(from), to);
  };
  for (const std::string& camera :
       {with("-7", "7"), with("[1, 2, -7]", "[30, 2, -7]"), with("-7", "-1e300"),
        with("\"fx\": 500", "\"fx\": 0"), with("[1, 0, 0]", "[1, 0]"),
        with("[1, 0, 0]", "[2, 0, 0]"), with("\"width\": 800, ", ""), std::string("7"),
        std::string("[]")}) {
    const Scene other = read(file_of(rows, "[" + camera + "]"));
    EXPECT_EQ(other.presentation.has_camera, 0U) << camera;
    ASSERT_EQ(other.notes.size(), 1U) << camera;
    EXPECT_EQ(other.notes[0].rfind("1 camera was not read: the first ", 0), 0U) << camera;
  }
  EXPECT_TRUE(read(file_of(rows, "[]")).notes.empty());
}

TEST_F(SplatvTest, ListsThatDoNotFitAreRefused) {
  const std::string texture(kTextureRow, '\1');
  const std::string good = entry(kTextureRow, 1);
  const auto with = [&](const char* from, const char* to) {
    std::string text = good;
    return text.replace(text.find(from), std::strlen(from), to);
  };
  const auto status = [&](const std::string& text) { return status_of(list_of(text) + texture); };
  EXPECT_EQ(status("[" + good + "]"), L4D_OK);
  for (const std::string& text :
       {std::string("{}"), std::string("[7]"), std::string("[{}]"), std::string("[]"),
        std::string("[" + good), good, "[" + with("\"splat\"", "3") + "]",
        "[" + with("65536", "65537") + "]", "[" + with("65536", "-1") + "]",
        "[" + with("65536", "1.5") + "]", "[" + with("65536", "18446744073709551615") + "]",
        "[" + with("65536", "64") + "]", "[" + with("\"texheight\": 1", "\"texheight\": 2") + "]",
        "[" + with("\"texheight\": 1", "\"x\": 1") + "]",
        "[" + with("\"splat\"", "\"other\"") + "]"}) {
    EXPECT_EQ(status(text), L4D_ERR_CORRUPT) << text;
  }
  EXPECT_EQ(status("[" + with("4096", "2048") + "]"), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(status_of(list_of("[" + good + ", " + good + "]") + texture + texture),
            L4D_ERR_FEATURE_UNSUPPORTED);
  std::string message;
  std::string long_list = list_of("[" + good + "]") + texture;
  long_list[7] = 1;
  EXPECT_EQ(status_of(long_list, &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("byte 4"), std::string::npos);
}

TEST_F(SplatvTest, WhatIsNotReadIsNamed) {
  const std::string list = list_of(R"([{"type": "sound", "size": 3}, )" + entry(0, 0) + "]");
  EXPECT_EQ(read(list + "abc").notes, std::vector<std::string>{"1 chunk was not read: sound."});
  EXPECT_EQ(read(list + "abcd").notes.back(), "1 byte behind the chunks was not read.");
}

TEST_F(SplatvTest, TruncationsAndChangedBytesDoNoHarm) {
  const std::string whole = file_of(packed(exact_row()), "[" + std::string(kEye) + "]");
  const size_t texture = whole.size() - kTextureRow;
  for (size_t size = 8; size < whole.size(); size += size < texture + 70 ? 1 : 997) {
    ASSERT_EQ(status_of(whole.substr(0, size)), L4D_ERR_CORRUPT) << size;
  }
  for (size_t at = 4; at < texture + 64; ++at) {
    for (const int change : {1, 128, 255}) {
      std::string bytes = whole;
      bytes[at] = static_cast<char>(bytes[at] ^ change);
      const l4d_status status = status_of(bytes);
      EXPECT_TRUE(status == L4D_OK || status == L4D_ERR_CORRUPT ||
                  status == L4D_ERR_FEATURE_UNSUPPORTED)
          << at << " " << status;
    }
  }
}

TEST_F(SplatvTest, CountsItsGaussiansAndItsList) {
  const auto status = [&](const std::string& bytes, uint64_t limit) {
    const MemoryBudget budget("limit", limit);
    const l4d_status found = test::status_of([&] { read(bytes, budget.holder()); });
    EXPECT_EQ(budget.held(), 0U);
    return found;
  };
  std::string rows;
  for (int k = 0; k < 1024; ++k) rows += packed(exact_row());
  EXPECT_EQ(status(file_of(rows), 100000), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_EQ(status(file_of(rows), 1000000), L4D_OK);
  const std::string deep(1000000, '[');
  EXPECT_EQ(status(list_of(deep), 20000000), L4D_ERR_LIMIT_EXCEEDED);
  // As deep as the limit of its length lets it be.
  const std::string cameras = deep + std::string(deep.size(), ']');
  EXPECT_EQ(status(file_of(rows, cameras), 0), L4D_OK);
}

}  // namespace
}  // namespace l4d::io
