// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/formats/scene_file.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

// 1, 1/4 and so on, as binary16.
constexpr uint16_t kOne = 0x3c00, kQuarter = 0x3400, kMinusHalf = 0xb800, kLeast = 1;

class KsplatTest : public test::IoTest {
 protected:
  struct Parts {
    uint16_t level = 1;
    uint16_t degree = 1;
    uint32_t count = 5;
    std::vector<uint32_t> partial = {1, 0, 2};  // behind one full bucket of 2
    uint8_t minor = 1;
  };
  static std::string header(const Parts& parts) {
    std::string file(4096 + 2 * 1024, '\0');
    const auto put = [&](size_t at, uint32_t value) { std::memcpy(&file[at], &value, 4); };
    file[1] = static_cast<char>(parts.minor);
    put(4, 2);  // sections, of which the first is empty
    put(8, 1);
    put(16, parts.count);
    file[20] = static_cast<char>(parts.level);
    const float least = -2, most = 2, block = 10;
    std::memcpy(&file[36], &least, 4);
    std::memcpy(&file[40], &most, 4);
    const size_t section = 4096 + 1024;
    put(section, parts.count);
    put(section + 4, parts.count + 1);  // room for one more
    if (parts.level > 0) {
      put(section + 8, 2);
      put(section + 12, static_cast<uint32_t>(1 + parts.partial.size()));
      std::memcpy(&file[section + 16], &block, 4);
      put(section + 20, 12);
      put(section + 24, 1000);
      put(section + 32, 1);
      put(section + 36, static_cast<uint32_t>(parts.partial.size()));
    }
    put(section + 40, parts.degree);
    return file;
  }
  static std::string file_of(const Parts& parts) {
    std::string file = header(parts);
    if (parts.level > 0) {
      for (const uint32_t size : parts.partial) test::append(file, size);
      for (size_t k = 0; k <= parts.partial.size(); ++k) {
        for (const float x : {0.0F, 1.0F, 2.0F})
          test::append(file, x + 100 * static_cast<float>(k));
      }
    }
    const int coefficients = (parts.degree + 1) * (parts.degree + 1) - 1;
    for (uint32_t i = 0; i < parts.count + 1; ++i) {
      if (parts.level == 0) {
        for (const float x : {1.5F, -2.0F, static_cast<float>(i)}) test::append(file, x);
        for (const float x : {1.0F, 0.25F, std::ldexp(1.0F, -24)}) test::append(file, x);
        for (const float x : {-0.5F, 0.25F, 1.0F, 0.0F}) test::append(file, x);
      } else {
        for (const int x : {1000, 1200, 0}) test::append(file, static_cast<uint16_t>(x));
        for (const uint16_t x : {kOne, kQuarter, kLeast}) test::append(file, x);
        for (const uint16_t x : {kMinusHalf, kQuarter, kOne, uint16_t{0}}) test::append(file, x);
      }
      for (const int c : {255, 0, 51, 102}) file += static_cast<char>(c);
      for (int k = 0; k < 3 * coefficients; ++k) {
        if (parts.level == 0) test::append(file, static_cast<float>(k));
        if (parts.level == 1) test::append(file, static_cast<uint16_t>(kOne + k * 16));
        if (parts.level == 2) file += static_cast<char>(k);
      }
    }
    return file;
  }
  Scene read(const std::string& bytes, const Hold& holder = {}) {
    ImportOptions options;
    options.seconds = 2;
    options.fps = 10;
    options.holder = holder;
    const std::string file = write("a.ksplat", bytes);
    return read_scene_file(file, file, options);
  }
  l4d_status status_of(const std::string& bytes, std::string* message = nullptr) {
    return test::status_of([&] { read(bytes); }, message);
  }
};

TEST_F(KsplatTest, AllLevelsAndDegreesAreRead) {
  for (uint16_t level = 0; level <= 2; ++level) {
    for (uint16_t degree = 0; degree <= 3; ++degree) {
      Parts parts;
      parts.level = level;
      parts.degree = degree;
      const Scene scene = read(file_of(parts));
      ASSERT_EQ(scene.count(), 5U);
      EXPECT_EQ(scene.source, "ksplat");
      EXPECT_EQ(scene.sh_degree, degree);
      EXPECT_EQ(scene.timeline.num_frames, 20U);
      // Buckets 0 0 1 3 3: the second of those that are not full is empty.
      const std::vector<float> bucket = {0, 0, 100, 300, 300};
      for (size_t i = 0; i < 5; ++i) {
        const float* p = &scene.position[3 * i];
        EXPECT_EQ(p[0], level == 0 ? 1.5F : bucket[i]);
        EXPECT_EQ(p[1], level == 0 ? -2 : bucket[i] + 1 + 200 * 10 / 2000.0F);
        EXPECT_EQ(p[2], level == 0 ? static_cast<float>(i) : bucket[i] + 2 - 5);
        const float* s = &scene.log_scale[4 * i];
        EXPECT_EQ(s[0], 0);
        EXPECT_NEAR(s[1], std::log(0.25), 1e-6);
        EXPECT_EQ(s[2], -16) << "raised from 2^-24";
        EXPECT_EQ(scene.opacity[i], 0.4F);
        const float* sh = &scene.sh[3 * scene.sh_coefficients() * i];
        EXPECT_NEAR(sh[0], 0.5 / 0.28209479, 1e-5);
        EXPECT_NEAR(sh[2], -0.3 / 0.28209479, 1e-5);
        // s, -z, y, -x of -1/2, 1/4, 1, 0
        const double norm = std::sqrt(0.25 + 0.0625 + 1);
        EXPECT_NEAR(scene.rotor[8 * i], -0.5 / norm, 1e-6);
        EXPECT_NEAR(scene.rotor[8 * i + 2], 1 / norm, 1e-6);
        EXPECT_NEAR(scene.rotor[8 * i + 3], -0.25 / norm, 1e-6);
        const auto value = [&](int k) {
          return level == 0 ? k : level == 1 ? 1 + k / 64.0 : -2 + 4 * k / 255.0;
        };
        if (degree > 0) {
          EXPECT_NEAR(sh[3 * 1 + 0], value(0), 1e-6);
          EXPECT_NEAR(sh[3 * 3 + 1], value(5), 1e-6);
        }
        if (degree > 1) {
          EXPECT_NEAR(sh[3 * 4 + 0], value(9), 1e-6);
          EXPECT_NEAR(sh[3 * 8 + 2], value(23), 1e-6);
        }
        if (degree > 2) {
          EXPECT_NEAR(sh[3 * 15 + 2], value(44), 1e-6);
        }
      }
    }
  }
}

TEST_F(KsplatTest, WhatDoesNotFitTogetherIsRefused) {
  std::string message;
  Parts parts;
  parts.minor = 0;
  EXPECT_EQ(status_of(file_of(parts)), L4D_ERR_FEATURE_UNSUPPORTED);
  parts = {};
  parts.level = 3;
  EXPECT_EQ(status_of(header(parts)), L4D_ERR_FEATURE_UNSUPPORTED);
  parts = {};
  parts.degree = 4;
  EXPECT_EQ(status_of(header(parts)), L4D_ERR_FEATURE_UNSUPPORTED);
  parts = {};
  parts.partial = {1, 1, 0};
  EXPECT_EQ(status_of(file_of(parts), &message), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("buckets hold fewer"), std::string::npos) << message;
  const auto changed = [&](size_t at, uint32_t value) {
    std::string file = file_of({});
    std::memcpy(&file[at], &value, 4);
    return file;
  };
  const size_t section = 4096 + 1024;
  const struct {
    size_t at;
    uint32_t value;
  } changes[] = {{4, 3},
                 {4, 0xffffffff},
                 {16, 6},
                 {section, 7},
                 {section + 4, 0xffffffff},
                 {section + 12, 0xffffffff},
                 {section + 20, 8},
                 {section + 32, 5},
                 {section + 36, 0xffffffff},
                 {section + 40, 3}};
  for (const auto& change : changes) {
    EXPECT_EQ(status_of(changed(change.at, change.value)), L4D_ERR_CORRUPT) << change.at;
  }
}

TEST_F(KsplatTest, TruncationsAndChangedBytesDoNoHarm) {
  for (uint16_t level = 0; level <= 2; ++level) {
    Parts parts;
    parts.level = level;
    const std::string whole = file_of(parts);
    for (size_t size = 4000; size < whole.size(); size += size < 6100 ? 97 : 1) {
      ASSERT_EQ(status_of(whole.substr(0, size)), L4D_ERR_CORRUPT) << level << " " << size;
    }
    for (size_t at = 0; at < whole.size(); ++at) {
      if (at == 44) at = 4096;
      if (at == 4096 + 44) at = 4096 + 1024;
      if (at == 4096 + 1024 + 44) at = 4096 + 2048;
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
}

TEST_F(KsplatTest, CountsItsGaussians) {
  const MemoryBudget budget("limit", 7000);
  EXPECT_EQ(test::status_of([&] { read(file_of({}), budget.holder()); }), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_EQ(budget.held(), 0U);
}

}  // namespace
}  // namespace l4d::io
