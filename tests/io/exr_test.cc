// SPDX-License-Identifier: Apache-2.0
#include "tests/common/exr.h"

#include <cmath>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "io/image/image.h"
#include "tests/common/ffmpeg.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using l4d::test::exr_of;
using l4d::test::ExrForm;
using l4d::test::primaries;
using l4d::test::small_exr;

// A stored value, and the colour that it is shown as.
struct Shown {
  uint16_t half;
  double value, colour;
};
const Shown kShown[] = {{0x0000, 0, 0},
                        {0x1400, 0.0009765625, 12.92 * 0.0009765625},
                        {0x3400, 0.25, 0.5370987},
                        {0x3800, 0.5, 0.7353569},
                        {0x3c00, 1, 1},
                        {0x4400, 4, 1},   // brighter than a screen
                        {0xbc00, -1, 0},  // of a filter
                        {0x7c00, INFINITY, 1},
                        {0xfc00, -INFINITY, 0},
                        {0x7e00, NAN, 0}};

double shown(double v) { return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055; }

class ExrTest : public test::IoTest {
 protected:
  void SetUp() override {
    if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
  }
  l4d_status status(const std::string& bytes, const ImageLimits& limits = {}) {
    const std::string file = write("a.exr", bytes);
    return test::status_of([&] { read_image(file, limits); });
  }
  std::string message(const std::string& bytes) {
    const std::string file = write("a.exr", bytes);
    std::string message;
    test::status_of([&] { read_image(file); }, &message);
    return message;
  }
  // A picture of a scale, by ffmpeg's own encoder.
  std::string encoded(const std::string& options) {
    const std::string command =
        "ffmpeg -v error -y -f lavfi -i "
        "\"color=black:s=20x18,format=rgba,geq=r=9*X:g=13*Y:b=5*(X+Y):a=255-4*X\" -frames:v 1 " +
        options + " '" + path("b.exr") + "'";
    EXPECT_EQ(std::system(command.c_str()), 0);
    return test::read_bytes(path("b.exr"));
  }
};

TEST_F(ExrTest, IsShownByTheFunctionOfSrgb) {
  // Each value as red, then as green, then as blue.
  const size_t n = std::size(kShown);
  ExrForm form;
  form.width = static_cast<uint32_t>(n);
  form.height = 3;
  form.channels = {{"B", {}}, {"G", {}}, {"R", {}}};
  for (size_t y = 0; y < 3; ++y) {
    for (size_t x = 0; x < n; ++x) {
      for (size_t c = 0; c < 3; ++c)
        form.channels[2 - c].second.push_back(kShown[(x + c + y) % n].half);
    }
  }
  const std::string file = write("a.exr", exr_of(form));
  std::vector<float> alpha = {5};
  const Image image = read_image(file, &alpha);
  EXPECT_TRUE(alpha.empty());
  ASSERT_EQ(image.width, n);
  ASSERT_EQ(image.height, 3U);
  for (size_t y = 0; y < 3; ++y) {
    for (size_t x = 0; x < n; ++x) {
      for (size_t c = 0; c < 3; ++c) {
        EXPECT_NEAR(image.rgb[3 * (y * n + x) + c], kShown[(x + c + y) % n].colour, 1e-6)
            << kShown[(x + c + y) % n].value;
      }
    }
  }
  EXPECT_FALSE(read_image_bytes(file));
  uint32_t size[2];
  ASSERT_TRUE(image_size(file, size));
  EXPECT_EQ(size[0], n);
  EXPECT_EQ(size[1], 3U);
}

TEST_F(ExrTest, ColoursAreDividedByAlpha) {
  ExrForm form;
  form.width = 5;
  // 1, a half, 0, more than 1, and none that is a number.
  form.channels = {{"A", {0x3c00, 0x3800, 0x0000, 0x4000, 0x7e00}},
                   {"B", {0x3400, 0x3400, 0x3c00, 0x3400, 0x3400}},
                   {"G", {0x0000, 0x0000, 0x0000, 0x0000, 0x0000}},
                   {"R", {0x3800, 0x3c00, 0x3c00, 0x3800, 0x3800}}};
  const std::string file = write("a.exr", exr_of(form));
  std::vector<float> alpha;
  const Image apart = read_image(file, &alpha);
  EXPECT_EQ(alpha, (std::vector<float>{1, 0.5F, 0, 1, 0}));
  const double a = shown(0.25), b = shown(0.5);
  const std::vector<double> colours = {b, 0, a, 1, 0, b, 0, 0, 0, b, 0, a, 0, 0, 0};
  const Image on_black = read_image(file);
  for (size_t i = 0; i < colours.size(); ++i) {
    EXPECT_NEAR(apart.rgb[i], colours[i], 1e-6) << i;
    // As a PNG of the same picture: by colours that are shown, and not by light.
    EXPECT_NEAR(on_black.rgb[i], colours[i] * static_cast<double>(alpha[i / 3]), 1e-6) << i;
  }
}

TEST_F(ExrTest, OfEachCompression) {
  const std::string plain = encoded("-pix_fmt gbrapf32le -compression none");
  std::vector<float> alpha, alpha_of_other;
  const Image image = read_image(write("a.exr", plain), &alpha);
  ASSERT_EQ(image.width, 20U);
  ASSERT_EQ(image.height, 18U);
  double most = 0;
  for (const float v : image.rgb) most = std::max<double>(most, v);
  EXPECT_GT(most, 0.5);
  for (const std::string compression : {"none", "rle", "zip1", "zip16"}) {
    for (const std::string type : {"float", "half"}) {
      const std::string options = " -compression " + compression + " -format " + type;
      const Image other =
          read_image(write("a.exr", encoded("-pix_fmt gbrapf32le" + options)), &alpha_of_other);
      ASSERT_TRUE(other.same_size(image));
      for (size_t i = 0; i < image.rgb.size(); ++i) {
        ASSERT_NEAR(other.rgb[i], image.rgb[i], type == "half" ? 1e-3 : 0) << options << i;
      }
      for (size_t i = 0; i < alpha.size(); ++i) {
        ASSERT_NEAR(alpha_of_other[i], alpha[i], type == "half" ? 1e-3 : 0) << options << i;
      }
      read_image(write("a.exr", encoded("-pix_fmt gbrpf32le" + options)), &alpha_of_other);
      EXPECT_TRUE(alpha_of_other.empty());
    }
  }
}

TEST_F(ExrTest, OfManyKinds) {
  const auto read = [&](const ExrForm& form) {
    return read_image(write("a.exr", exr_of(form))).rgb;
  };
  const ExrForm plain = small_exr();
  const std::vector<float> values = read(plain);
  ExrForm form = plain;  // depths beside them, and the parts of an image
  form.channels.insert(form.channels.begin() + 1, {"AO", std::vector<uint16_t>(6, 0x3c00)});
  form.channels.push_back({"S.R", std::vector<uint16_t>(6, 0x3c00)});
  form.channels.push_back({"Z", std::vector<uint16_t>(6, 0x3c00)});
  EXPECT_EQ(read(form), values);
  form = plain;
  form.tile = 2;
  EXPECT_EQ(read(form), values);
  form = plain;  // those of sRGB, rounded otherwise
  form.more = {{"chromaticities", primaries(0.64F, 0.3129F)}};
  EXPECT_EQ(read(form), values);
}

TEST_F(ExrTest, IsRefusedByName) {
  const auto expect = [&](const ExrForm& form, const std::string& words) {
    const std::string bytes = exr_of(form);
    EXPECT_EQ(status(bytes), L4D_ERR_FEATURE_UNSUPPORTED) << words;
    const std::string text = message(bytes);
    EXPECT_EQ(text.rfind(path("a.exr") + ": an EXR ", 0), 0U) << text;
    EXPECT_NE(text.find(words), std::string::npos) << text;
    uint32_t size[2];
    EXPECT_EQ(test::status_of([&] { image_size(path("a.exr"), size); }),
              L4D_ERR_FEATURE_UNSUPPORTED);
  };
  const auto named = [](const std::vector<std::string>& names) {
    ExrForm form;
    for (const std::string& name : names) form.channels.push_back({name, {0x3c00}});
    return form;
  };
  expect(named({"Y"}), "the channels Y; R, G and B");
  expect(named({"BY", "RY", "Y"}), "BY, RY, Y");
  expect(named({"V.Combined.B", "V.Combined.G", "V.Combined.R"}), "V.Combined.B");
  expect(named({"B", "G", "R", "a"}), "B, G, R, a");  // ffmpeg takes it for alpha
  expect(named({"b", "g", "r"}), "b, g, r");
  expect(named({"B", "G"}), "B, G");
  ExrForm form = small_exr();
  form.type_of_first = 0;
  expect(form, "A, B, G, R");
  form.type_of_first = 2;
  expect(form, "A, B, G, R");
  form = small_exr();
  form.sampling = 2;
  expect(form, "A, B, G, R");
  for (const auto& [flag, words] :
       {std::pair(0x800U, "deep"), std::pair(0x1000U, "several parts")}) {
    form = small_exr();
    form.flags = flag;
    expect(form, words);
  }
  form = small_exr();
  form.compression = 8;
  expect(form, "DWA");
  form.compression = 4;
  form.type_of_first = 1;
  form.channels.push_back({"Z", std::vector<uint16_t>(12)});
  form.type_of_last = 2;
  expect(form, "PIZ");
  form.compression = 99;
  expect(form, "not known");
  form = small_exr();
  form.display_width = 4;
  expect(form, "dataWindow");
  form = small_exr();
  form.left = 1;
  expect(form, "dataWindow");
  form = small_exr();
  form.tile = 2;
  form.tile_mode = 1;
  expect(form, "mipmap");
  form = small_exr();
  form.more = {{"chromaticities", primaries(0.713F, 0.32168F)}};  // ACEScg
  expect(form, "primaries");
}

TEST_F(ExrTest, ThatIsDamaged) {
  const std::string good = exr_of(small_exr());
  ASSERT_EQ(status(good), L4D_OK);
  for (size_t size = 4; size < good.size(); size += size + 12 < good.size() ? size_t{5} : 1) {
    const std::string file = write("a.exr", good.substr(0, size));
    std::string words;
    EXPECT_EQ(test::status_of([&] { read_image(file); }, &words), L4D_ERR_CORRUPT) << size;
    EXPECT_EQ(words.rfind(file + ": bad EXR: ", 0), 0U) << size << words;
    EXPECT_EQ(test::status_of([&] { read_image_bytes(file); }), L4D_ERR_CORRUPT) << size;
  }
  // All but values of pixels, of which nothing says that they are wrong: an error, or the image.
  constexpr size_t kRow = 24, kBeforeRow = 8;
  const std::vector<float> values = read_image(write("a.exr", good)).rgb;
  for (size_t i = 0; i < good.size() - kRow; i += 3) {
    if (i + 2 * kRow + kBeforeRow >= good.size() && i + kRow + kBeforeRow < good.size()) continue;
    std::string bad = good;
    bad[i] = static_cast<char>(bad[i] ^ 0x10);
    const std::string file = write("a.exr", bad);
    std::vector<float> got;
    const l4d_status result = test::status_of([&] { got = read_image(file).rgb; });
    EXPECT_TRUE(result == L4D_OK
                    ? got == values
                    : result == L4D_ERR_CORRUPT || result == L4D_ERR_FEATURE_UNSUPPORTED)
        << i;
  }
  // ZIP has a sum of each block. ffmpeg leaves black what it cannot unpack, and goes on.
  std::string zip = encoded("-pix_fmt gbrpf32le -compression zip16");
  ASSERT_EQ(status(zip), L4D_OK);
  zip[zip.size() - 100] = static_cast<char>(zip[zip.size() - 100] ^ 0x10);
  EXPECT_EQ(status(zip), L4D_ERR_CORRUPT);
  EXPECT_NE(message(zip).find(path("a.exr") + ": bad EXR: "), std::string::npos) << message(zip);
}

TEST_F(ExrTest, IsCounted) {
  const std::string bytes = exr_of(small_exr());
  EXPECT_EQ(status(bytes, {3, 2, {}}), L4D_OK);
  EXPECT_EQ(status(bytes, {2, 3, {}}), L4D_ERR_CORRUPT);
  // The file and its copy, six pixels of 4 floats.
  const uint64_t needed = 2 * bytes.size() + 6 * 16;
  const MemoryBudget little("--limit-memory", needed - 1), enough("--limit-memory", needed);
  EXPECT_EQ(status(bytes, {0, 0, little.holder()}), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_EQ(status(bytes, {0, 0, enough.holder()}), L4D_OK);
  EXPECT_EQ(enough.held(), 0U);
  ExrForm large = small_exr();
  large.claimed_width = L4D_MAX_IMAGE_SIDE + 1;
  EXPECT_EQ(status(exr_of(large)), L4D_ERR_CORRUPT);
  large.claimed_width = L4D_MAX_IMAGE_SIDE;
  EXPECT_EQ(status(exr_of(large)), L4D_ERR_CORRUPT);
}

TEST_F(ExrTest, WhateverItsNameIs) {
  const std::string bytes = exr_of(small_exr());
  for (const std::string name : {"%03d.exr", "concat:a|b.exr", "-i", "pixels.png"}) {
    EXPECT_EQ(read_image(write(name, bytes)).width, 3U) << name;
  }
}

TEST(ExrWithoutFfmpegTest, SaysWhatIsMissing) {
  const std::string before = getenv("PATH");
  setenv("PATH", "/nowhere", 1);
  const std::string file = ::testing::TempDir() + "/l4d_no_ffmpeg.exr";
  std::ofstream(file, std::ios::binary) << exr_of(small_exr());
  std::string text;
  EXPECT_EQ(test::status_of([&] { read_image(file); }, &text), L4D_ERR_IO);
  setenv("PATH", before.c_str(), 1);
  std::filesystem::remove(file);
  EXPECT_NE(text.find(file + ": "), std::string::npos) << text;
  EXPECT_NE(text.find("install ffmpeg"), std::string::npos) << text;
}

}  // namespace
}  // namespace l4d::io
