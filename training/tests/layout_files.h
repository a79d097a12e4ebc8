// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "libl4dcodec/base/half.h"
#include "tests/common/exr.h"
#include "tests/common/jpeg.h"
#include "training/capture/capture.h"
#include "training/tests/tiny_capture.h"

// A capture whose truth is known, as files of a layout.
namespace l4d::train::test {

constexpr uint32_t kCameras = 5, kFrames = 4;

// 5 cameras of the tiny capture, 4 frames; camera 0 tests.
struct Truth {
  std::vector<l4d_camera> cameras;
  std::string frames = tiny_capture() + "/images";
  std::string image(uint32_t camera, uint32_t frame) const {
    char name[64];
    std::snprintf(name, sizeof(name), "/cam%02u/%04u.png", camera, frame);
    return frames + name;
  }
  Truth() {
    const Capture capture = read_capture(tiny_capture(), {});
    for (uint32_t c = 0; c < kCameras; ++c) {
      cameras.push_back(capture.cameras[c].source.camera);
    }
  }
};

inline std::string name_of(uint32_t camera) { return "cam0" + std::to_string(camera); }

inline void write_text(const std::string& path, const std::string& text) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path, std::ios::binary) << text;
}

inline std::string digits(double value) {
  char text[40];
  std::snprintf(text, sizeof(text), "%.17g", value);
  return text;
}

// As light, of which a half keeps more than 8 bits of a PNG.
inline std::string exr_of_image(const io::Image& image) {
  l4d::test::ExrForm form;
  form.width = image.width;
  form.height = image.height;
  form.channels = {{"B", {}}, {"G", {}}, {"R", {}}};
  for (size_t i = 0; i < image.rgb.size(); ++i) {
    const float v = image.rgb[i];
    const float light = v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
    form.channels[2 - i % 3].second.push_back(float_to_half(light));
  }
  return l4d::test::exr_of(form);
}

// From a PNG to a PNG, a JPEG or an EXR.
inline void copy_image(const std::string& from, const std::string& to) {
  if (std::filesystem::path(to).extension() == ".png") {
    std::filesystem::copy_file(from, to);
    return;
  }
  const io::Image image = io::read_image(from);
  if (std::filesystem::path(to).extension() == ".exr") {
    write_text(to, exr_of_image(image));
    return;
  }
  std::vector<uint8_t> bytes(image.rgb.size());
  io::to_bytes(image.rgb.data(), bytes.size(), bytes.data());
  write_text(to, l4d::test::jpeg_of(image.width, image.height, bytes));
}

inline void copy_images(const Truth& truth, const std::string& folder, const char* pattern) {
  for (uint32_t c = 0; c < kCameras; ++c) {
    std::filesystem::create_directories(folder + "/images/" + name_of(c));
    for (uint32_t f = 0; f < kFrames; ++f) {
      char name[40];
      std::snprintf(name, sizeof(name), pattern, f);
      copy_image(truth.image(c, f), folder + "/images/" + name_of(c) + "/" + name);
    }
  }
}

// A quaternion of the rotation of a camera.
inline void quaternion_of(const l4d_camera& camera, double* q) {
  const double* m = camera.world_to_camera;
  const double r[9] = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
  double best = 0;
  for (size_t k = 0; k < 4; ++k) {
    // Four times the square of each component.
    const double s[4] = {1 + r[0] + r[4] + r[8], 1 + r[0] - r[4] - r[8], 1 - r[0] + r[4] - r[8],
                         1 - r[0] - r[4] + r[8]};
    if (s[k] <= best) continue;
    best = s[k];
    const double h = std::sqrt(s[k]) / 2, f = 1 / (4 * h);
    const double a = (r[7] - r[5]) * f, b = (r[2] - r[6]) * f, c = (r[3] - r[1]) * f;
    const double ab = (r[1] + r[3]) * f, ac = (r[2] + r[6]) * f, bc = (r[5] + r[7]) * f;
    const double all[4][4] = {{h, a, b, c}, {a, h, ab, ac}, {b, ab, h, bc}, {c, ac, bc, h}};
    std::copy_n(all[k], 4, q);
  }
}

template <typename T>
inline void put(std::string* to, T value) {
  to->append(reinterpret_cast<const char*>(&value), sizeof(T));
}

inline void write_colmap(const Truth& truth, const std::string& folder, bool binary,
                         const char* pattern = "%04u.png") {
  copy_images(truth, folder, pattern);
  std::string cameras, images, points;
  if (binary) {
    put<uint64_t>(&cameras, kCameras);
    put<uint64_t>(&images, kCameras);
  }
  for (uint32_t c = 0; c < kCameras; ++c) {
    const l4d_camera& k = truth.cameras[c];
    double q[4];
    quaternion_of(k, q);
    const double t[3] = {k.world_to_camera[3], k.world_to_camera[7], k.world_to_camera[11]};
    if (binary) {
      put<uint32_t>(&cameras, c + 1);
      put<int32_t>(&cameras, 1);
      put<uint64_t>(&cameras, 64);
      put<uint64_t>(&cameras, 48);
      for (const double value : {k.fx, k.fy, k.cx, k.cy}) put(&cameras, value);
      put<uint32_t>(&images, 7 + c);
      for (const double value : q) put(&images, value);
      for (const double value : t) put(&images, value);
      put<uint32_t>(&images, c + 1);
      images += name_of(c) + ".png" + '\0';
      put<uint64_t>(&images, 1);
      images += std::string(24, '\1');
      continue;
    }
    cameras += "# a comment\n" + std::to_string(c + 1) + " OPENCV 64 48";
    for (const double value : {k.fx, k.fy, k.cx, k.cy, 0.0, 0.0, 0.0, 0.0})
      cameras += " " + digits(value);
    images += std::to_string(7 + c);
    for (const double value : q) images += " " + digits(value);
    for (const double value : t) images += " " + digits(value);
    cameras += "\n";
    images += " " + std::to_string(c + 1) + " " + name_of(c) + ".png\n1.5 2.5 -1\n";
  }
  const std::string end = binary ? ".bin" : ".txt", model = folder + "/sparse/0/";
  write_text(model + "cameras" + end, cameras);
  write_text(model + "images" + end, images);
  if (binary) {
    put<uint64_t>(&points, 1);
    put<uint64_t>(&points, 3);
    for (const double value : {0.5, 0.25, -1.0}) put(&points, value);
    points += "\xff\x80";
    points += '\0';
    put(&points, 0.1);
    put<uint64_t>(&points, 1);
    put<uint64_t>(&points, 0);
  } else {
    points = "3 0.5 0.25 -1 255 128 0 0.1 1 2\n";
  }
  write_text(model + "points3D" + end, points);
}

inline void expect_error(const std::string& path, l4d_status status, const std::string& word) {
  try {
    read_capture(path, {});
    ADD_FAILURE() << path << ": no error about " << word;
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), status) << error.what();
    EXPECT_THAT(error.what(), testing::HasSubstr(word));
  }
}

}  // namespace l4d::train::test
