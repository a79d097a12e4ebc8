// SPDX-License-Identifier: Apache-2.0
#include "io/image/image.h"

#include <cmath>
#include <optional>

#include "tests/io/support.h"

namespace l4d::io {
namespace {

class ImageTest : public test::IoTest {};

uint32_t crc32(const std::string& bytes) {
  uint32_t crc = 0xffffffffU;
  for (const char c : bytes) {
    crc ^= static_cast<uint8_t>(c);
    for (int k = 0; k < 8; ++k) crc = crc & 1 ? crc >> 1 ^ 0xedb88320U : crc >> 1;
  }
  return ~crc;
}

std::string chunk(const std::string& type, const std::string& data) {
  std::string bytes;
  test::append<uint32_t>(bytes, __builtin_bswap32(static_cast<uint32_t>(data.size())));
  bytes += type + data;
  test::append<uint32_t>(bytes, __builtin_bswap32(crc32(type + data)));
  return bytes;
}

// A zlib stream of one stored block.
std::string stored(const std::string& data) {
  std::string bytes = "\x78\x01\x01";
  test::append<uint16_t>(bytes, static_cast<uint16_t>(data.size()));
  test::append<uint16_t>(bytes, static_cast<uint16_t>(~data.size()));
  uint32_t a = 1, b = 0;
  for (const char c : data) {
    a = (a + static_cast<uint8_t>(c)) % 65521;
    b = (b + a) % 65521;
  }
  bytes += data;
  test::append<uint32_t>(bytes, __builtin_bswap32(b << 16 | a));
  return bytes;
}

// `rows` are those of the file, each after its filter byte.
std::string png(uint32_t width, uint32_t height, int depth, int color_type, const std::string& rows,
                const std::string& chunks = "") {
  std::string header;
  test::append<uint32_t>(header, __builtin_bswap32(width));
  test::append<uint32_t>(header, __builtin_bswap32(height));
  for (const int value : {depth, color_type, 0, 0, 0}) header += static_cast<char>(value);
  return "\x89PNG\r\n\x1a\n" + chunk("IHDR", header) + chunks + chunk("IDAT", stored(rows)) +
         chunk("IEND", "");
}

std::string text_of(std::initializer_list<int> bytes) {
  std::string text;
  for (const int b : bytes) text += static_cast<char>(b);
  return text;
}

TEST_F(ImageTest, PngRoundTripKeepsBytes) {
  Image image(37, 21);
  reference::Random random(3);
  for (float& v : image.rgb) v = static_cast<float>(random.below(256)) / 255;
  write_png(path("a.png"), image);
  EXPECT_EQ(files_in_directory(), 1U);
  const Image back = read_image(path("a.png"));
  EXPECT_TRUE(back.same_size(image));
  EXPECT_TRUE(test::same_bits(back.rgb, image.rgb));
  // A caller may stop it at each row, and nothing is left.
  int rows = 0;
  const auto stop = [&] {
    if (++rows == 5) throw Error(L4D_ERR_CANCELLED, "stop");
  };
  EXPECT_EQ(test::status_of([&] { write_png(path("b.png"), image, stop); }), L4D_ERR_CANCELLED);
  EXPECT_EQ(files_in_directory(), 1U);
}

TEST_F(ImageTest, PngClampsAndRounds) {
  Image image(2, 2);
  image.rgb = {
      -1,       2,         NAN,  0.4999F / 255, 0.5001F / 255, 254.49F / 255, 254.51F / 255,
      INFINITY, -INFINITY, 0.2F, 0.4F,          0.6F};
  write_png(path("a.png"), image);
  const int expected[] = {0, 255, 0, 0, 1, 254, 255, 255, 0, 51, 102, 153};
  const Image back = read_image(path("a.png"));
  for (size_t i = 0; i < 12; ++i) {
    EXPECT_EQ(std::lround(back.rgb[i] * 255), expected[i]) << i;
  }
}

TEST_F(ImageTest, PngOfManyKinds) {
  const auto read = [&](const std::string& bytes) { return read_image(write("a.png", bytes)).rgb; };
  const auto expect = [&](const std::string& bytes, const std::vector<double>& values) {
    const std::vector<float> rgb = read(bytes);
    ASSERT_EQ(rgb.size(), values.size());
    for (size_t i = 0; i < values.size(); ++i) EXPECT_NEAR(rgb[i], values[i], 1e-7) << i;
  };
  // 8-bit grey and grey of one bit
  expect(png(2, 1, 8, 0, text_of({0, 10, 20})),
         {10 / 255., 10 / 255., 10 / 255., 20 / 255., 20 / 255., 20 / 255.});
  expect(png(2, 1, 1, 0, text_of({0, 0x40})), {0, 0, 0, 1, 1, 1});
  // a palette of two colours, the second transparent to a half
  expect(png(2, 1, 8, 3, text_of({0, 0, 1}),
             chunk("PLTE", text_of({1, 2, 3, 100, 200, 50})) + chunk("tRNS", text_of({255, 51}))),
         {1 / 255., 2 / 255., 3 / 255., 20 / 255., 40 / 255., 10 / 255.});
  // alpha over black, as stored values and not as light
  expect(png(1, 1, 8, 6, text_of({0, 100, 200, 50, 51})), {20 / 255., 40 / 255., 10 / 255.});
  expect(png(1, 1, 8, 4, text_of({0, 200, 0})), {0, 0, 0});
  // 16 bits keep what 8 bits lose, whatever gamma the file claims
  expect(png(1, 1, 16, 2, text_of({0, 0x12, 0x34, 0xff, 0xff, 0x00, 0x01}),
             chunk("gAMA", text_of({0, 1, 0x86, 0xa0}))),
         {0x1234 / 65535., 1, 1 / 65535.});
}

TEST_F(ImageTest, PngWithAlphaKeptApart) {
  std::vector<float> alpha = {5, 5};
  Image image = read_image(write("a.png", png(1, 1, 8, 6, text_of({0, 100, 200, 50, 51}))), &alpha);
  ASSERT_EQ(alpha.size(), 1U);
  EXPECT_NEAR(alpha[0], 51 / 255., 1e-7);
  EXPECT_NEAR(image.rgb[0], 100 / 255., 1e-7);
  EXPECT_NEAR(image.rgb[1], 200 / 255., 1e-7);
  image = read_image(write("a.png", png(1, 1, 8, 2, text_of({0, 100, 200, 50}))), &alpha);
  EXPECT_TRUE(alpha.empty());
  EXPECT_NEAR(image.rgb[2], 50 / 255., 1e-7);
}

TEST_F(ImageTest, PngAsBytes) {
  const auto read = [&](const std::string& bytes) {
    return read_image_bytes(write("a.png", bytes));
  };
  const std::optional<ByteImage> plain =
      read(png(2, 1, 8, 2, text_of({0, 1, 2, 3, 253, 254, 255})));
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->width, 2U);
  EXPECT_EQ(plain->height, 1U);
  EXPECT_EQ(plain->rgb, (std::vector<uint8_t>{1, 2, 3, 253, 254, 255}));
  EXPECT_TRUE(plain->alpha.empty());
  const std::optional<ByteImage> clear =
      read(png(1, 2, 8, 6, text_of({0, 100, 200, 50, 51, 0, 1, 2, 3, 0})));
  ASSERT_TRUE(clear);
  EXPECT_EQ(clear->rgb, (std::vector<uint8_t>{100, 200, 50, 1, 2, 3}));
  EXPECT_EQ(clear->alpha, (std::vector<uint8_t>{51, 0}));
  EXPECT_FALSE(read(png(1, 1, 16, 2, text_of({0, 0x12, 0x34, 0xff, 0xff, 0x00, 0x01}))));
  EXPECT_EQ(test::status_of([&] { read_image_bytes(path("absent.png")); }), L4D_ERR_IO);
  EXPECT_EQ(test::status_of([&] {
              read(png(2, 2, 8, 2, text_of({0, 1, 2, 3})));
            }),
            L4D_ERR_CORRUPT);
}

TEST_F(ImageTest, RefusesWhatIsTooLargeBeforeItIsDecoded) {
  // Pixels that nobody could decode: the size is looked at first.
  const std::string file = write("a.png", png(2, 1, 8, 2, text_of({0, 1, 2, 3, 253, 254, 255})));
  const auto status = [&](const ImageLimits& limits) {
    return std::vector<l4d_status>{test::status_of([&] { read_image(file, limits); }),
                                   test::status_of([&] { read_image_bytes(file, limits); })};
  };
  using Statuses = std::vector<l4d_status>;
  EXPECT_EQ(status({2, 1, {}}), Statuses(2, L4D_OK));
  EXPECT_EQ(status({1, 2, {}}), Statuses(2, L4D_ERR_CORRUPT));
  const MemoryBudget none("--limit-memory", 1), little("--limit-memory", 100),
      enough("--limit-memory", 1000);
  EXPECT_EQ(status({2, 1, none.holder()}), Statuses(2, L4D_ERR_LIMIT_EXCEEDED));
  EXPECT_EQ(status({0, 0, little.holder()}), Statuses(2, L4D_ERR_LIMIT_EXCEEDED));
  EXPECT_EQ(status({2, 1, enough.holder()}), Statuses(2, L4D_OK));
  EXPECT_EQ(enough.held(), 0U);
}

TEST_F(ImageTest, PngThatIsDamaged) {
  const std::string good = png(2, 2, 8, 2, text_of({0, 1, 2, 3, 4, 5, 6, 0, 7, 8, 9, 10, 11, 12}));
  const auto status = [&](const std::string& bytes) {
    const std::string file = write("a.png", bytes);
    return test::status_of([&] { read_image(file); });
  };
  ASSERT_EQ(status(good), L4D_OK);
  for (size_t size = 0; size < good.size(); ++size) {
    EXPECT_EQ(status(good.substr(0, size)), L4D_ERR_CORRUPT) << size;
  }
  for (size_t i = 0; i < good.size(); ++i) {  // nothing but an error or an image may come of it
    std::string bad = good;
    bad[i] = static_cast<char>(bad[i] ^ 0x10);
    const l4d_status result = status(bad);
    EXPECT_TRUE(result == L4D_OK || result == L4D_ERR_CORRUPT) << i;
  }
  const std::string row = text_of({0, 1, 2, 3});
  EXPECT_EQ(status(png(16384, 16384, 16, 6, row)), L4D_ERR_CORRUPT);
  EXPECT_EQ(status(png(16385, 1, 8, 2, row)), L4D_ERR_CORRUPT);
  EXPECT_EQ(status(png(0x7fffffff, 0x7fffffff, 8, 2, row)), L4D_ERR_CORRUPT);
  EXPECT_EQ(test::status_of([&] { read_image(path("absent.png")); }), L4D_ERR_IO);
}

TEST_F(ImageTest, PngThatCannotBeWritten) {
  EXPECT_EQ(test::status_of([&] { write_png(path("no/a.png"), Image(1, 1)); }), L4D_ERR_IO);
  EXPECT_EQ(test::status_of([&] { write_png(path("a.png"), Image()); }), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(files_in_directory(), 0U);
}

TEST_F(ImageTest, SideBySide) {
  Image a(1, 2), b(2, 2);
  a.rgb = {1, 2, 3, 4, 5, 6};
  b.rgb = {10, 11, 12, 13, 14, 15, 20, 21, 22, 23, 24, 25};
  const Image c = side_by_side({a, b});
  EXPECT_EQ(c.width, 3U);
  EXPECT_EQ(c.height, 2U);
  EXPECT_EQ(c.rgb, (std::vector<float>{1, 2, 3, 10, 11, 12, 13, 14, 15,  //
                                       4, 5, 6, 20, 21, 22, 23, 24, 25}));
  EXPECT_EQ(test::status_of([&] { side_by_side({a, Image(1, 3)}); }), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(test::status_of([] { side_by_side({}); }), L4D_ERR_INVALID_ARGUMENT);
}

double lightness(const float* rgb) {  // CIE L* of an sRGB colour
  double linear[3];
  for (size_t c = 0; c < 3; ++c) {
    const double v = static_cast<double>(rgb[c]);
    linear[c] = v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
  }
  const double y = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  return y <= 216.0 / 24389 ? y * 24389 / 27 : 116 * std::cbrt(y) - 16;
}

TEST_F(ImageTest, ErrorMapIsEvenInLightness) {
  Image a(101, 1), b(101, 1);
  for (size_t x = 0; x <= 100; ++x) {  // errors 0, 0.005, ... 0.5 as means of three channels
    b.rgb[3 * x] = static_cast<float>(x) * 0.015F;
  }
  const Image map = error_map(a, b, 2);
  for (size_t x = 0; x <= 100; ++x) {
    EXPECT_NEAR(lightness(&map.rgb[3 * x]), 0.96 * static_cast<double>(x), 1.6) << x;
    if (x > 0) {
      EXPECT_GT(lightness(&map.rgb[3 * x]), lightness(&map.rgb[3 * x - 3]));
    }
  }
  EXPECT_TRUE(test::same_bits(error_map(b, a, 2).rgb, map.rgb));
  const Image cut = error_map(a, b, 1000);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(cut.rgb[k], 0.0F);
    EXPECT_EQ(cut.rgb[300 + k], map.rgb[300 + k]);
  }
  EXPECT_EQ(test::status_of([&] { error_map(a, Image(1, 1), 1); }), L4D_ERR_INVALID_ARGUMENT);
}

TEST(Captions, StandInTheirPartOfAStripBelow) {
  Image image(120, 64);
  std::fill(image.rgb.begin(), image.rgb.end(), 0.25F);
  const Image out = captioned(image, {"|", "a far too long caption"});
  ASSERT_EQ(out.width, 120U);
  ASSERT_EQ(out.height, 78U);
  EXPECT_TRUE(std::equal(image.rgb.begin(), image.rgb.end(), out.rgb.begin()));
  size_t left = 0, right = 0;
  for (size_t y = 64; y < 78; ++y) {
    for (size_t x = 0; x < 120; ++x) {
      const bool lit = out.rgb[3 * (120 * y + x)] > 0.5F;
      (x < 60 ? left : right) += lit;
      EXPECT_TRUE(!lit || x >= 60 || x == 6) << x;  // the bar is one column
    }
  }
  EXPECT_EQ(left, 6U);
  EXPECT_GT(right, 60U);
}

}  // namespace
}  // namespace l4d::io
