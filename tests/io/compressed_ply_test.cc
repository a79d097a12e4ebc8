// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/formats/scene_file.h"
#include "io/ply/scene_ply.h"
#include "io/sequence/sequence.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

constexpr const char* kRanges[] = {
    "min_x",       "min_y",       "min_z",       "max_x",       "max_y",       "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r",       "min_g",       "min_b",       "max_r",       "max_g",       "max_b"};

class CompressedPlyTest : public test::IoTest {
 protected:
  struct Parts {
    size_t count = 257;  // two chunks
    size_t chunks = 2;
    size_t harmonics = 9;
    bool colors = true;
    std::string packed_type = "uint";
  };

  static std::string file_of(const Parts& parts) {
    std::string file = "ply\nformat binary_little_endian 1.0\ncomment of a test\n";
    file += "element chunk " + std::to_string(parts.chunks) + "\n";
    const size_t ranges = parts.colors ? 18 : 12;
    for (size_t k = 0; k < ranges; ++k) file += std::string("property float ") + kRanges[k] + "\n";
    file += "element vertex " + std::to_string(parts.count) + "\n";
    for (const char* name : {"position", "rotation", "scale", "color"}) {
      file += "property " + parts.packed_type + " packed_" + name + "\n";
    }
    if (parts.harmonics > 0) {
      file += "element sh " + std::to_string(parts.count) + "\n";
      for (size_t k = 0; k < parts.harmonics; ++k) {
        file += "property uchar f_rest_" + std::to_string(k) + "\n";
      }
    }
    file += "end_header\n";
    for (size_t chunk = 0; chunk < parts.chunks; ++chunk) {
      const float c = static_cast<float>(chunk);
      for (const float x : {-1.0F, 0.0F, 2.0F, 1.0F, 4.0F, 2.0F}) test::append(file, x + 10 * c);
      for (const float x : {-8.0F, -6.0F, -4.0F, -4.0F, -5.0F, -4.0F}) test::append(file, x);
      if (!parts.colors) continue;
      for (const float x : {0.0F, -1.0F, 0.5F, 2.0F, 1.0F, 0.5F}) test::append(file, x);
    }
    for (size_t i = 0; i < parts.count; ++i) {
      // The whole of x, a quarter of y nearly, nothing of z.
      test::append<uint32_t>(file, (2047U << 21) | (256U << 11) | 0U);
      // The second number, x, is the largest; w is -sqrt(1/2), y and z are next to 0.
      test::append<uint32_t>(file, (1U << 30) | (0U << 20) | (512U << 10) | 511U);
      test::append<uint32_t>(file, (0U << 21) | (1023U << 11) | 5U);
      test::append<uint32_t>(file, (255U << 24) | (51U << 16) | (0U << 8) | 204U);
    }
    for (size_t i = 0; i < parts.count && parts.harmonics > 0; ++i) {
      for (size_t k = 0; k < parts.harmonics; ++k) {
        file += static_cast<char>(k == 0 ? 0 : k == 1 ? 255 : 127 + k);
      }
    }
    return file;
  }
  Scene read(const std::string& bytes, const Hold& holder = {}) {
    ImportOptions options;
    options.seconds = 2;
    options.fps = 10;
    options.holder = holder;
    const std::string file = write("a.compressed.ply", bytes);
    return read_scene_file(file, file, options);
  }
  l4d_status status_of(const Parts& parts, std::string* message = nullptr) {
    return test::status_of([&] { read(file_of(parts)); }, message);
  }
};

TEST_F(CompressedPlyTest, NumbersAreThoseOfTheirChunk) {
  const Scene scene = read(file_of({}));
  ASSERT_EQ(scene.count(), 257U);
  EXPECT_EQ(scene.source, "compressed_ply");
  EXPECT_EQ(scene.sh_degree, 1U);
  EXPECT_EQ(scene.timeline.num_frames, 20U);
  for (const size_t i : {size_t{0}, size_t{255}, size_t{256}}) {
    const float of_chunk = i < 256 ? 0.0F : 10.0F;
    EXPECT_EQ(scene.position[3 * i], 1 + of_chunk);
    EXPECT_NEAR(scene.position[3 * i + 1], 4 * 256 / 1023.0 + of_chunk, 1e-5);
    EXPECT_EQ(scene.position[3 * i + 2], 2 + of_chunk);
    EXPECT_EQ(scene.log_scale[4 * i], -8);
    EXPECT_EQ(scene.log_scale[4 * i + 1], -5);
    EXPECT_EQ(scene.log_scale[4 * i + 2], -4);
    EXPECT_EQ(scene.opacity[i], 0.8F);
    const float* sh = &scene.sh[12 * i];
    EXPECT_NEAR(sh[0], (2 - 0.5) / 0.28209479, 1e-5);
    EXPECT_NEAR(sh[1], (-0.6 - 0.5) / 0.28209479, 1e-5);
    EXPECT_NEAR(sh[2], 0, 1e-6);
    // Red has f_rest_0 to f_rest_2. The ends of the range are kept, and others are middles.
    EXPECT_EQ(sh[3], -4);
    EXPECT_EQ(sh[6], 4);
    EXPECT_EQ(sh[9], (129.5F / 256 - 0.5F) * 8);
    EXPECT_EQ(sh[4], (130.5F / 256 - 0.5F) * 8);
    // s, -z, y, -x of the quaternion; w is -sqrt(1/2).
    const double step = std::sqrt(2.0) / 1023;
    const float* rotor = &scene.rotor[8 * i];
    EXPECT_NEAR(rotor[0], -std::sqrt(0.5), step);
    EXPECT_NEAR(rotor[1], 0, step);
    EXPECT_NEAR(rotor[2], 0, step);
    EXPECT_NEAR(rotor[3], -std::sqrt(0.5), step);
  }
}

TEST_F(CompressedPlyTest, FilesOfBeforeHaveNoRangesOfColours) {
  Parts parts;
  parts.colors = false;
  parts.harmonics = 0;
  const Scene scene = read(file_of(parts));
  EXPECT_EQ(scene.sh_degree, 0U);
  EXPECT_NEAR(scene.sh[0], 0.5 / 0.28209479, 1e-5);
  EXPECT_NEAR(scene.sh[1], (0.2 - 0.5) / 0.28209479, 1e-5);
}

TEST_F(CompressedPlyTest, FramesOfASequenceMayBeCompressed) {
  SequenceOptions options;
  options.paths = {write("0.ply", file_of({})), write("1.ply", file_of({}))};
  SequenceReport report;
  const Scene scene = read_sequence(options, &report);
  EXPECT_EQ(report.rows, 514U);
  EXPECT_EQ(report.matched, 257U);
  EXPECT_EQ(scene.count(), 257U);
}

TEST_F(CompressedPlyTest, WhatDoesNotFitTogetherIsRefused) {
  std::string message;
  Parts parts;
  parts.chunks = 1;
  EXPECT_EQ(status_of(parts, &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("1 chunks of 256 for 257"), std::string::npos) << message;
  parts = {};
  parts.packed_type = "int";
  EXPECT_EQ(status_of(parts, &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("packed_position"), std::string::npos) << message;
  parts = {};
  parts.harmonics = 8;
  EXPECT_EQ(status_of(parts), L4D_ERR_CORRUPT);
  parts.harmonics = 72;
  EXPECT_EQ(status_of(parts), L4D_ERR_FEATURE_UNSUPPORTED);
  std::string bytes = file_of({});
  bytes.replace(bytes.find("element sh 257"), 14, "element sh 250");
  EXPECT_EQ(test::status_of([&] { read(bytes); }), L4D_ERR_CORRUPT);
  bytes = file_of({});
  bytes.replace(bytes.find("element chunk"), 13, "element chonk");
  EXPECT_EQ(test::status_of([&] { read(bytes); }), L4D_ERR_CORRUPT);
}

TEST_F(CompressedPlyTest, RangesFromEndToBeginAreRefused) {
  std::string file = file_of({});
  std::string bytes[2];
  test::append(bytes[0], -4.0F);  // the largest of the scales along x, of the first chunk
  test::append(bytes[1], -8.5F);
  const size_t at = file.find(bytes[0], file.find("end_header"));
  file.replace(at + 4, 4, bytes[1]);  // after min_scale_z, which is -4, too
  std::string message;
  EXPECT_EQ(test::status_of([&] { read(file); }, &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("element chunk, row 0: min_scale_x is above max_scale_x"),
            std::string::npos)
      << message;
}

TEST_F(CompressedPlyTest, EveryTruncationIsRefused) {
  Parts parts;
  parts.count = 3;
  parts.chunks = 1;
  const std::string whole = file_of(parts);
  for (size_t size = 4; size < whole.size(); ++size) {
    ASSERT_EQ(test::status_of([&] { read(whole.substr(0, size)); }), L4D_ERR_CORRUPT) << size;
  }
}

TEST_F(CompressedPlyTest, CountsWhatAHeaderPromises) {
  const MemoryBudget budget("limit", 50000);
  EXPECT_EQ(test::status_of([&] { read(file_of({}), budget.holder()); }), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_EQ(budget.held(), 0U);
  std::string bytes = file_of({});
  for (const char* element : {"element vertex 257", "element sh 257"}) {
    bytes.replace(bytes.find(element), std::string(element).size(),
                  std::string(element).substr(0, std::string(element).size() - 3) + "4000000000");
  }
  EXPECT_EQ(test::status_of([&] { read(bytes); }), L4D_ERR_CORRUPT);
}

}  // namespace
}  // namespace l4d::io
