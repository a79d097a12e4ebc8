// SPDX-License-Identifier: Apache-2.0
#include "io/camera/colmap.h"

#include "io/camera/cameras.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

const std::string kLens = "1 PINHOLE 64 48 50 50 32 24\n";

// The line of an image; names may be numbers and have blanks.
std::string image(int id, const std::string& name) {
  return std::to_string(id) + " 1 0 0 0 -" + std::to_string(id) + " 0 6 1 " + name + "\n";
}

class ColmapTest : public test::IoTest {
 protected:
  CameraSet read(const std::string& cameras, const std::string& images) const {
    write("cameras.txt", cameras);
    write("images.txt", images);
    return read_cameras(path(""));
  }
  CameraSet read(const std::string& images) const { return read(kLens, images); }
  void expect_refused(const std::string& cameras, const std::string& images,
                      const std::string& what) const {
    std::string message;
    EXPECT_EQ(test::status_of([&] { read(cameras, images); }, &message), L4D_ERR_CORRUPT) << images;
    EXPECT_NE(message.find(what), std::string::npos) << what << ": " << message;
  }
};

TEST_F(ColmapTest, AnImageHasTwoLines) {
  const std::string a = image(1, "cam 2.jpg"), b = image(2, "cam 1.jpg\r");
  EXPECT_EQ(read(a + "1 2 3 4.5 6.25 -1\n" + b).cameras.size(), 2U);
  std::vector<std::string> names;
  read_colmap_cameras(path(""), &names, {});
  EXPECT_EQ(names, (std::vector<std::string>{"cam 1.jpg", "cam 2.jpg"}));
  EXPECT_EQ(read("# comment\n\n" + a + "\n" + b + " \r\n\n").cameras.size(), 2U);
}

// Every second image would be taken for the points of the one before it.
TEST_F(ColmapTest, ImagesWithoutLinesOfPointsAreRefused) {
  for (const char* ending : {".png", "", " 1", " 8 9", " a b"}) {
    std::string images = "# comment\n";
    for (int k = 1; k <= 6; ++k) images += image(k, "00" + std::to_string(k) + ending);
    expect_refused(kLens, images,
                   path("images.txt") + ": line 3: the line of points of the image 001" + ending +
                       " is missing");
  }
}

TEST_F(ColmapTest, ListsAreReadWholeOrRefused) {
  const std::string a = image(1, "a.jpg");
  const struct {
    std::string cameras, images;
    const char* message;
  } cases[] = {
      {kLens, a + "1 2\n", "line 2: the line of points"},
      {kLens, a + "1 2 3.5\n", "line 2: the line of points"},
      {kLens, a + "1 2 -2\n", "line 2: the line of points"},
      {kLens, a + "1 nan 3\n", "line 2: the line of points"},
      {kLens, a + "1 2 3x\n", "line 2: the line of points"},
      {kLens, a + "\nb.jpg 1\n", "line 3: an image lacks its number"},
      {kLens, "1 1 0 0 0 0.5 0 2 1 \n", "line 1: an image lacks its name"},
      {kLens, "1 1 0 0 0 0.5 0 2\n", "line 1: an image lacks numbers"},
      {kLens, "1 1 0 0 0 0.5 0 2 1.5 a\n", "line 1: an image lacks numbers"},
      {kLens, a + "\n" + image(1, "b.jpg"), "images.txt: there are two images of the number 1"},
      {kLens, a + "\n" + image(2, "a.jpg"), "images.txt: there are two images a.jpg"},
      {kLens + kLens, a, "two cameras 1"},
      {"PINHOLE 64 48 50 50 32 24\n", a, "line 1: a camera lacks its number, model or size"},
      {"\n1 PINHOLE 64 48 50 50 32 24 9\n", a, "line 2: a camera has more parameters than PINHOLE"},
  };
  for (const auto& c : cases) expect_refused(c.cameras, c.images, c.message);
}

TEST_F(ColmapTest, AHeaderThatStatesAnotherNumberIsNoted) {
  const std::string images = image(1, "a.jpg") + "\n" + image(2, "b.jpg") + "\n";
  const auto notes = [&](const std::string& header) { return read(header + images).notes; };
  EXPECT_EQ(notes("# Number of images: 2, mean observations per image: 0.5\n").size(), 1U);
  EXPECT_EQ(notes("# Number of images: many\n").size(), 1U);
  const std::vector<std::string> other = notes("# Number of images: 6, mean: 0.5\n");
  ASSERT_EQ(other.size(), 2U);
  EXPECT_EQ(other[0], "images.txt states 6 images, and has 2.");
}

template <typename T>
void put(std::string* to, T value) {
  to->append(reinterpret_cast<const char*>(&value), sizeof(T));
}

TEST_F(ColmapTest, TwoImagesOfOneNumberOrNameAreRefusedInBinaryFilesToo) {
  std::string cameras, message;
  put<uint64_t>(&cameras, 1);
  put<uint32_t>(&cameras, 1);
  put<int32_t>(&cameras, 1);
  for (const uint64_t size : {64U, 48U}) put<uint64_t>(&cameras, size);
  for (const double value : {50.0, 50.0, 32.0, 24.0}) put(&cameras, value);
  write("cameras.bin", cameras);
  const auto status = [&](uint32_t number, const std::string& name) {
    std::string images;
    put<uint64_t>(&images, 2);
    for (const bool is_second : {false, true}) {
      put<uint32_t>(&images, is_second ? number : 1);
      for (const double value : {1, 0, 0, 0, 0, 0, 6}) put(&images, value);
      put<uint32_t>(&images, 1);
      images += (is_second ? name : "a.jpg") + '\0';
      put<uint64_t>(&images, 0);
    }
    write("images.bin", images);
    return test::status_of([&] { read_cameras(path("")); }, &message);
  };
  EXPECT_EQ(status(2, "b.jpg"), L4D_OK) << message;
  EXPECT_EQ(status(1, "b.jpg"), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("images.bin: there are two images of the number 1"), std::string::npos)
      << message;
  EXPECT_EQ(status(2, "a.jpg"), L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("images.bin: there are two images a.jpg"), std::string::npos) << message;
}

}  // namespace
}  // namespace l4d::io
