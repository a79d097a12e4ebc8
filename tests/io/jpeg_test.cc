// SPDX-License-Identifier: Apache-2.0
#include "tests/common/jpeg.h"

#include <cmath>

#include "io/image/image.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using l4d::test::jpeg_of;
using l4d::test::JpegForm;

constexpr uint32_t kWidth = 24, kHeight = 16;

// Blocks of 8x8 pixels, each of one grey: 3 beside each other, 2 rows of them.
std::vector<uint8_t> blocks(size_t channels) {
  std::vector<uint8_t> samples;
  for (uint32_t y = 0; y < kHeight; ++y) {
    for (uint32_t x = 0; x < kWidth; ++x) {
      samples.insert(samples.end(), channels, static_cast<uint8_t>(40 * (y / 8 * 3 + x / 8)));
    }
  }
  return samples;
}

class JpegTest : public test::IoTest {
 protected:
  // The greys of the blocks of the image in 40ths, row by row.
  std::string read(const std::string& bytes, const ImageLimits& limits = {}) {
    const std::string file = write("a.jpg", bytes);
    const std::optional<ByteImage> image = read_image_bytes(file, limits);
    const Image values = read_image(file, limits);
    EXPECT_TRUE(image->alpha.empty());
    std::string greys;
    for (uint32_t y = 4; y < image->height; y += 8) {
      for (uint32_t x = 4; x < image->width; x += 8) {
        const size_t at = 3 * (size_t{y} * image->width + x);
        for (size_t c = 0; c < 3; ++c) {
          EXPECT_NEAR(image->rgb[at + c], image->rgb[at], 1);
          EXPECT_EQ(values.rgb[at + c], static_cast<float>(image->rgb[at + c]) / 255);
        }
        greys += static_cast<char>('0' + std::lround(image->rgb[at] / 40.0));
      }
      greys += ' ';
    }
    return greys;
  }
  l4d_status status(const std::string& bytes, const ImageLimits& limits = {}) {
    const std::string file = write("a.jpg", bytes);
    return test::status_of([&] { read_image(file, limits); });
  }
};

TEST_F(JpegTest, ColoursAndGreys) {
  EXPECT_EQ(read(jpeg_of(kWidth, kHeight, blocks(3))), "012 345 ");
  EXPECT_EQ(read(jpeg_of(kWidth, kHeight, blocks(1), {JCS_GRAYSCALE})), "012 345 ");
  // More 0xff before a marker, as the standard allows.
  const std::string plain = jpeg_of(kWidth, kHeight, blocks(3));
  EXPECT_EQ(read(plain.substr(0, 2) + "\xff\xff" + plain.substr(2)), "012 345 ");
  uint32_t size[2];
  ASSERT_TRUE(image_size(path("a.jpg"), size));
  EXPECT_EQ(size[0], kWidth);
  EXPECT_EQ(size[1], kHeight);
  // Red, green and blue keep their places.
  std::vector<uint8_t> orange;
  for (size_t i = 0; i < 64; ++i) orange.insert(orange.end(), {200, 100, 20});
  const Image image = read_image(write("a.jpg", jpeg_of(8, 8, orange)));
  for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(255 * image.rgb[c], orange[c], 3);
  EXPECT_EQ(status(jpeg_of(kWidth, kHeight, blocks(4), {JCS_CMYK})), L4D_ERR_FEATURE_UNSUPPORTED);
}

TEST_F(JpegTest, IsTurnedWhereTheCameraIs) {
  const ImageLimits stored{kWidth, kHeight, {}}, shown{kHeight, kWidth, {}};
  // What the first row and column are of the picture that is shown, by EXIF: 5 left and top, 6
  // right and top, 7 right and bottom, 8 left and bottom.
  const char* const kShown[] = {"03 14 25 ", "30 41 52 ", "52 41 30 ", "25 14 03 "};
  for (unsigned orientation = 0; orientation <= 9; ++orientation) {
    const std::string bytes = jpeg_of(kWidth, kHeight, blocks(3), {JCS_RGB, orientation});
    EXPECT_EQ(read(bytes), "012 345 ");
    EXPECT_EQ(read(bytes, stored), "012 345 ");
    if (orientation >= 5 && orientation <= 8) {
      EXPECT_EQ(read(bytes, shown), kShown[orientation - 5]) << orientation;
    } else {
      EXPECT_EQ(status(bytes, shown), L4D_ERR_CORRUPT) << orientation;
    }
    EXPECT_EQ(status(bytes, {kWidth, kHeight + 1, {}}), L4D_ERR_CORRUPT);
  }
}

TEST_F(JpegTest, ThatIsDamaged) {
  const std::string good = jpeg_of(kWidth, kHeight, blocks(3), {JCS_RGB, 6});
  ASSERT_EQ(status(good), L4D_OK);
  // The last two, which end the file, one by one.
  const size_t whole = good.size() - 2;
  for (size_t size = 0; size < good.size(); size += size < whole - 5 ? 5 : 1) {
    EXPECT_EQ(status(good.substr(0, size)), L4D_ERR_CORRUPT) << size;
  }
  for (size_t i = 0; i < good.size(); i += 3) {  // nothing but an error or an image may come of it
    std::string bad = good;
    bad[i] = static_cast<char>(bad[i] ^ 0x10);
    const l4d_status result = status(bad);
    EXPECT_TRUE(result == L4D_OK || result == L4D_ERR_CORRUPT ||
                result == L4D_ERR_FEATURE_UNSUPPORTED)
        << i;
  }
  // A picture for previews behind the end, as cameras write, is none of this one.
  EXPECT_EQ(status(good + good), L4D_OK);
  JpegForm slow;
  slow.scan_a_coefficient = true;
  EXPECT_EQ(status(jpeg_of(kWidth, kHeight, blocks(3), slow)), L4D_ERR_CORRUPT);
}

TEST_F(JpegTest, IsCounted) {
  const std::string bytes = jpeg_of(kWidth, kHeight, blocks(3));
  const MemoryBudget little("--limit-memory", 2 * bytes.size() + 24 * kWidth * kHeight - 1),
      enough("--limit-memory", 2 * bytes.size() + 24 * kWidth * kHeight);
  EXPECT_EQ(status(bytes, {0, 0, little.holder()}), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_EQ(status(bytes, {0, 0, enough.holder()}), L4D_OK);
  EXPECT_EQ(enough.held(), 0U);
}

}  // namespace
}  // namespace l4d::io
