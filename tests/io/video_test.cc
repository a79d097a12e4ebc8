// SPDX-License-Identifier: Apache-2.0
#include "io/image/video.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>

#include "io/camera/cameras.h"
#include "io/image/metrics.h"
#include "tests/common/ffmpeg.h"
#include "tests/common/files.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

class VideoTest : public test::IoTest {
 protected:
  void SetUp() override {
    if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
  }
};

using VideoFilesTest = test::IoTest;

// A picture that tells its number: level and slope change from frame to frame.
Image frame(uint32_t width, uint32_t height, uint32_t number) {
  Image image(width, height);
  for (size_t y = 0; y < height; ++y) {
    for (size_t x = 0; x < width; ++x) {
      float* rgb = &image.rgb[3 * (y * width + x)];
      rgb[0] = 0.1F + 0.07F * static_cast<float>(number);
      rgb[1] = 0.2F + 0.6F * static_cast<float>(x) / static_cast<float>(width);
      rgb[2] = 0.8F - 0.6F * static_cast<float>(y) / static_cast<float>(height);
    }
  }
  return image;
}

std::string write_video(const std::string& path, uint32_t width, uint32_t height, uint32_t frames) {
  VideoWriter writer(path, width, height);
  for (uint32_t k = 0; k < frames; ++k) writer.write(frame(width, height, k));
  writer.finish();
  return path;
}

TEST_F(VideoTest, RoundTrip) {
  VideoReader reader(write_video(path("a.mp4"), 96, 64, 10), 96, 64);
  EXPECT_EQ(files_in_directory(), 1U);
  Image image;
  for (uint32_t k = 0; k < 10; ++k) {
    EXPECT_EQ(reader.position(), k);
    ASSERT_TRUE(reader.next(&image));
    ASSERT_TRUE(image.same_size(frame(96, 64, k)));
    EXPECT_GT(psnr_of_mse(mse(image, frame(96, 64, k))), 36) << k;
    if (k > 0) {
      EXPECT_LT(psnr_of_mse(mse(image, frame(96, 64, k - 1))), 30) << k;
    }
  }
  EXPECT_FALSE(reader.next(&image));
  EXPECT_FALSE(reader.next(&image));
}

// The bytes of a video, whose coded frames are in the box mdat.
std::string damaged(const std::string& file, const std::function<void(char*, size_t)>& damage) {
  const std::vector<uint8_t> bytes = read_whole_file(file);
  std::string out(bytes.begin(), bytes.end());
  const size_t begin = out.find("mdat") + 4, end = out.find("moov", begin);
  const size_t frames = (end == std::string::npos ? out.size() : end) - begin;
  damage(&out[begin + frames / 2], frames / 2);
  return out;
}

TEST_F(VideoTest, DamageIsFoundAndItsFrameNamed) {
  const std::string good = write_video(path("a.mp4"), 96, 64, 40);
  EXPECT_NO_THROW(check_video(good, 96, 64));
  EXPECT_NO_THROW(decode_video(good, 96, 64, 40));
  EXPECT_EQ(test::status_of([&] { check_video(good, 96, 66); }), L4D_ERR_CORRUPT);
  EXPECT_EQ(test::status_of([&] { decode_video(good, 96, 64, 41); }), L4D_ERR_CORRUPT);
  std::string message;
  const std::string zeros =
      write("zeros.mp4", damaged(good, [](char* at, size_t) { std::fill_n(at, 60, '\0'); }));
  EXPECT_EQ(test::status_of([&] { check_video(zeros, 96, 64); }, &message), L4D_ERR_CORRUPT);
  EXPECT_THAT(message, testing::ContainsRegex("zeros.mp4: frame [0-9]+ is damaged"));
  // What no scan finds ends the decoder: frames are refused, and none is made up.
  const std::string noise = write("noise.mp4", damaged(good, [](char* at, size_t size) {
                                    for (size_t k = 0; k + 1 < size && k < 600; ++k) {
                                      at[k] = static_cast<char>(at[k] ^ (k % 7 == 0 ? 0x5a : 0));
                                    }
                                  }));
  EXPECT_EQ(test::status_of([&] { decode_video(noise, 96, 64, 40); }, &message), L4D_ERR_CORRUPT);
  EXPECT_THAT(message, testing::ContainsRegex("noise.mp4: frame [0-9]+ or one soon after it"));
}

// The times of packets count, be they as uneven as phones have them.
TEST_F(VideoTest, FramesHaveTheirOwnTimes) {
  const std::string good = write_video(path("a.mp4"), 96, 64, 20);
  const auto make = [&](const std::string& name, const std::string& arguments) {
    const std::string command =
        "ffmpeg -v error -i '" + good + "' " + arguments + " '" + path(name) + "'";
    EXPECT_EQ(std::system(command.c_str()), 0);
    return path(name);
  };
  // Matroska rounds times to milliseconds.
  const std::string same = make("same.mkv", "-c copy");
  const VideoFacts steady = probe_video(same);
  ASSERT_EQ(steady.times.size(), 20U);
  for (size_t k = 0; k < 20; ++k) EXPECT_NEAR(steady.times[k], static_cast<double>(k) / 30, 6e-4);
  EXPECT_NEAR(steady.fps, 30, 0.1);
  check_video(same, 96, 64);
  const std::string uneven =
      make("uneven.mkv", "-vf \"select='not(between(n,3,5)+eq(n,10))'\" -vsync passthrough");
  const VideoFacts facts = probe_video(uneven);
  EXPECT_NEAR(facts.fps, 30, 0.1);
  size_t k = 0;
  for (const int frame : {0, 1, 2, 6, 7, 8, 9, 11, 12, 13, 14, 15, 16, 17, 18, 19}) {
    ASSERT_LT(k, facts.times.size());
    EXPECT_NEAR(facts.times[k++], frame / 30.0, 6e-4);
  }
  ASSERT_EQ(facts.times.size(), k);
  // Where frames alone count, that is no video of 30 frames a second.
  std::string message;
  EXPECT_EQ(test::status_of([&] { check_video(uneven, 96, 64); }, &message), L4D_ERR_CORRUPT);
  EXPECT_THAT(message, testing::HasSubstr("frame 3 comes at 0.2 s, and "));
  // Frames are found by their times.
  VideoReader whole(uneven, 96, 64);
  Image image, found;
  whole.read(3, &image);
  VideoRange range;
  range.first = 3;
  range.seek = (facts.times[2] + facts.times[3]) / 2;
  VideoReader(uneven, 96, 64, range).read(3, &found);
  EXPECT_EQ(found.rgb, image.rgb);
}

TEST_F(VideoTest, FactsWithoutDecoding) {
  VideoOptions options;
  options.fps = 25;
  VideoWriter writer(path("a.mp4"), 96, 64, options);
  for (uint32_t k = 0; k < 13; ++k) writer.write(frame(96, 64, k));
  writer.finish();
  const VideoFacts facts = probe_video(path("a.mp4"));
  EXPECT_EQ(facts.width, 96U);
  EXPECT_EQ(facts.height, 64U);
  EXPECT_EQ(facts.frames, 13U);
  EXPECT_NEAR(facts.fps, 25, 1e-6);
  EXPECT_THROW(probe_video(path("none.mp4")), Error);
  EXPECT_THROW(probe_video(write("list.mp4", "ffconcat version 1.0\nfile a.mp4\n")), Error);
}

TEST_F(VideoTest, RangesBeginWhereTheyAreAskedTo) {
  const std::string file = write_video(path("a.mp4"), 96, 64, 10);
  VideoReader whole(file, 96, 64);
  std::vector<Image> frames(10);
  for (Image& image : frames) ASSERT_TRUE(whole.next(&image));
  for (const uint32_t first : {1U, 4U, 9U}) {
    VideoRange range;
    range.first = first;
    range.seek = (first - 0.5) / 30;
    VideoReader reader(file, 96, 64, range);
    Image image;
    for (uint32_t k = first; k < 10; ++k) {
      EXPECT_EQ(reader.position(), k);
      ASSERT_TRUE(reader.next(&image));
      EXPECT_EQ(image.rgb, frames[k].rgb) << first << " " << k;
    }
    EXPECT_FALSE(reader.next(&image));
  }
  VideoRange half;
  half.out_width = 48;
  half.out_height = 32;
  VideoReader reader(file, 96, 64, half);
  std::vector<uint8_t> rgb;
  ASSERT_TRUE(reader.next(&rgb));
  EXPECT_EQ(rgb.size(), 3U * 48 * 32);
  VideoRange unknown;
  unknown.first = 3;
  EXPECT_THROW(VideoReader(file, 96, 64, unknown), Error);
}

TEST_F(VideoTest, SelectedFrames) {
  VideoReader reader(write_video(path("a.mp4"), 96, 64, 10), 96, 64);
  Image image;
  for (const uint32_t k : {0U, 3U, 4U, 9U}) {
    reader.read(k, &image);
    EXPECT_GT(psnr_of_mse(mse(image, frame(96, 64, k))), 36) << k;
  }
  EXPECT_EQ(test::status_of([&] { reader.read(9, &image); }), L4D_ERR_INVALID_ARGUMENT);
  std::string message;
  EXPECT_EQ(test::status_of([&] { reader.read(10, &image); }, &message), L4D_ERR_IO);
  EXPECT_NE(message.find("ends after 10"), std::string::npos) << message;
}

TEST_F(VideoTest, OddSizesArePadded) {
  VideoReader reader(write_video(path("a.mp4"), 33, 21, 2), 34, 22);
  Image image;
  ASSERT_TRUE(reader.next(&image));
  for (size_t y = 0; y < 22; ++y) EXPECT_LT(image.rgb[3 * (y * 34 + 33) + 1], 0.3F);
  const Image expected = frame(33, 21, 0);
  double sum = 0;
  for (size_t y = 0; y < 20; ++y) {
    for (size_t i = 0; i < 3 * 32; ++i) {
      sum += std::pow(static_cast<double>(image.rgb[y * 34 * 3 + i] - expected.rgb[y * 33 * 3 + i]),
                      2);
    }
  }
  EXPECT_GT(psnr_of_mse(sum / (20 * 3 * 32)), 30);
}

TEST_F(VideoTest, AnotherSizeIsAnError) {
  write_video(path("a.mp4"), 96, 64, 2);
  Image image;
  std::string message;
  for (const uint32_t width : {64U, 48U, 192U}) {
    VideoReader reader(path("a.mp4"), width, 6144 / width);
    EXPECT_EQ(test::status_of([&] { reader.next(&image); }, &message), L4D_ERR_CORRUPT);
    EXPECT_NE(message.find("camera's size"), std::string::npos);
  }
}

// The same frames, which players turn by a quarter; false if this ffmpeg cannot say so.
bool write_turned(const std::string& from, const std::string& to) {
  const std::vector<std::vector<std::string>> ways = {
      {"-display_rotation", "90", "-i", from, "-c", "copy", to},
      {"-i", from, "-c", "copy", "-metadata:s:v:0", "rotate=90", to}};
  return std::any_of(ways.begin(), ways.end(), [&](std::vector<std::string> words) {
    words.insert(words.begin(), "-y");
    try {
      FfmpegProcess process(to, words, FfmpegProcess::Direction::kFrom);
      char text[256];
      while (process.read(text, sizeof text) > 0) {
      }
      process.finish();
      return has_size(to, probe_video(to), 64, 96);
    } catch (const Error&) {
      return false;
    }
  });
}

TEST_F(VideoTest, IsTurnedWhereTheCameraIs) {
  write_video(path("a.mp4"), 96, 64, 3);
  if (!write_turned(path("a.mp4"), path("b.mp4"))) GTEST_SKIP() << "ffmpeg states no rotation";
  EXPECT_FALSE(has_size(path("a.mp4"), probe_video(path("a.mp4")), 64, 96));
  check_video(path("b.mp4"), 64, 96);
  check_video(path("b.mp4"), 96, 64);
  EXPECT_EQ(test::status_of([&] { check_video(path("b.mp4"), 64, 64); }), L4D_ERR_CORRUPT);
  for (const bool halved : {false, true}) {
    const uint32_t by = halved ? 2 : 1, width = 96 / by, height = 64 / by;
    VideoRange range;
    if (halved) range.out_width = width, range.out_height = height;
    const Image truth = frame(width, height, 1);
    Image image;
    // A camera that sees frames as they are stored.
    VideoReader(path("b.mp4"), 96, 64, range).read(1, &image);
    EXPECT_GT(psnr_of_mse(mse(image, truth)), 30);
    // And one that sees them as they are shown: by the left or by the right.
    if (halved) range.out_width = height, range.out_height = width;
    VideoReader(path("b.mp4"), 64, 96, range).read(1, &image);
    ASSERT_TRUE(image.same_size(Image(height, width)));
    Image left(height, width), right(height, width);
    for (size_t y = 0; y < width; ++y) {
      for (size_t x = 0; x < height; ++x) {
        const size_t to = 3 * (y * height + x);
        std::copy_n(&truth.rgb[3 * (x * width + width - 1 - y)], 3, &left.rgb[to]);
        std::copy_n(&truth.rgb[3 * ((height - 1 - x) * width + y)], 3, &right.rgb[to]);
      }
    }
    EXPECT_GT(psnr_of_mse(std::min(mse(image, left), mse(image, right))), 30);
  }
}

TEST_F(VideoTest, FilesThatAreNoVideo) {
  Image image;
  std::string message;
  const std::string text = write("a.mp4", "no video at all");
  VideoReader reader(text, 16, 16);
  EXPECT_EQ(test::status_of([&] { reader.next(&image); }, &message), L4D_ERR_IO);
  EXPECT_NE(message.find(text + ": ffmpeg failed: "), std::string::npos) << message;
  EXPECT_EQ(test::status_of([&] { VideoReader(path("absent.mp4"), 16, 16); }), L4D_ERR_IO);
  EXPECT_EQ(test::status_of([&] { VideoReader(text, 0, 16); }), L4D_ERR_INVALID_ARGUMENT);
}

TEST_F(VideoTest, NamesAreNamesOnly) {
  // A scheme of ffmpeg's, a pattern of numbers and characters of shells, were they not just a name.
  const std::string name = path("concat:a%03d $(b) 'c.mp4");
  VideoReader reader(write_video(name, 32, 32, 1), 32, 32);
  Image image;
  EXPECT_TRUE(reader.next(&image));
  EXPECT_TRUE(std::filesystem::exists(name));
}

TEST_F(VideoTest, UnfinishedLeavesNothing) {
  write("a.mp4", "before");
  {
    VideoWriter writer(path("a.mp4"), 32, 32);
    writer.write(frame(32, 32, 0));
    EXPECT_EQ(test::status_of([&] { writer.write(frame(32, 30, 0)); }), L4D_ERR_INVALID_ARGUMENT);
  }
  EXPECT_EQ(test::read_bytes(path("a.mp4")), "before");
  EXPECT_EQ(files_in_directory(), 1U);
  EXPECT_EQ(test::status_of([&] { VideoWriter(path("no/a.mp4"), 32, 32); }), L4D_ERR_IO);
  EXPECT_EQ(test::status_of([&] { VideoWriter("/dev/null", 32, 32); }), L4D_ERR_IO);
}

TEST_F(VideoTest, AnEncoderThatDiesIsAnError) {
  // A stand-in for an ffmpeg that reads nothing: writing to it must not end this process.
  const std::string tools = path("tools");
  std::filesystem::create_directory(tools);
  std::ofstream(tools + "/ffmpeg") << "#!/bin/sh\nexec 0<&-\necho out of luck >&2\nexit 3\n";
  std::filesystem::permissions(tools + "/ffmpeg", std::filesystem::perms::owner_all);
  const std::string before = std::getenv("PATH");
  ASSERT_EQ(setenv("PATH", tools.c_str(), 1), 0);
  std::string message;
  const l4d_status status = test::status_of(
      [&] {
        VideoWriter writer(path("a.mp4"), 640, 480);
        for (int k = 0; k < 20; ++k) writer.write(Image(640, 480));
        writer.finish();
      },
      &message);
  setenv("PATH", before.c_str(), 1);
  EXPECT_EQ(status, L4D_ERR_IO);
  EXPECT_NE(message.find("ffmpeg failed: out of luck"), std::string::npos) << message;
  EXPECT_EQ(files_in_directory(), 1U);
}

// ffmpeg exits with 0 where the disk is full when it writes the last part of a file.
TEST_F(VideoTest, APartOfAFileIsAnError) {
  const std::string tools = path("tools");
  const std::string before = std::getenv("PATH");
  std::filesystem::create_directory(tools);
  for (const char* left : {"700", "5000", "0"}) {
    std::ofstream(tools + "/ffmpeg")
        << "#!/bin/sh\nPATH='" << before << "'\nffmpeg \"$@\"\nfor last; do :; done\n"
        << "truncate -s " << left << " \"${last#file:}\"\necho the disk is full >&2\n";
    std::filesystem::permissions(tools + "/ffmpeg", std::filesystem::perms::owner_all);
    ASSERT_EQ(setenv("PATH", tools.c_str(), 1), 0);
    std::string message;
    const l4d_status status =
        test::status_of([&] { write_video(path("a.mp4"), 640, 480, 20); }, &message);
    setenv("PATH", before.c_str(), 1);
    EXPECT_EQ(status, L4D_ERR_IO) << left;
    EXPECT_NE(message.find("a part of the video: the disk is full"), std::string::npos) << message;
    EXPECT_EQ(files_in_directory(), 1U);
  }
}

TEST_F(VideoTest, WithoutFfmpeg) {
  write_video(path("a.mp4"), 32, 32, 1);
  const std::string before = std::getenv("PATH");
  ASSERT_EQ(setenv("PATH", path("empty").c_str(), 1), 0);
  const bool available = l4d::test::ffmpeg_available();
  std::string message;
  const l4d_status reading = test::status_of([&] { VideoReader(path("a.mp4"), 32, 32); }, &message);
  const l4d_status writing = test::status_of([&] { VideoWriter(path("b.mp4"), 32, 32); });
  setenv("PATH", before.c_str(), 1);
  EXPECT_FALSE(available);
  EXPECT_EQ(reading, L4D_ERR_IO);
  EXPECT_EQ(writing, L4D_ERR_IO);
  EXPECT_NE(message.find("install ffmpeg"), std::string::npos) << message;
  EXPECT_EQ(files_in_directory(), 1U);
}

// What is a video by its name is so wherever a folder of videos is read.
TEST_F(VideoFilesTest, AreTheVideosOfAFolder) {
  for (const char* name : {"b.MKV", "a.mp4", "c.webm", "._a.mp4", "a.mp4.txt", "mp4", "c.json"}) {
    write(name, "");
  }
  const std::filesystem::path folder = path("");
  const std::vector<std::filesystem::path> found = videos_in(folder);
  EXPECT_THAT(found, testing::ElementsAre(folder / "a.mp4", folder / "b.MKV", folder / "c.webm"));
  EXPECT_TRUE(videos_in(folder / "nowhere").empty());
}

TEST_F(VideoTest, OfBasketball) {
  const std::string file = l4d::test::data_file("basketball/cameras.json");
  if (file.empty()) GTEST_SKIP() << "no data set";
  const Camera camera = read_cameras(file).cameras[0];
  VideoReader reader(camera.video, camera.camera.width, camera.camera.height);
  Image first, other;
  reader.read(0, &first);
  reader.read(149, &other);
  EXPECT_FALSE(reader.next(&other));
  EXPECT_LT(psnr_of_mse(mse(first, other)), 30);  // people have moved
  EXPECT_GT(psnr_of_mse(mse(first, other)), 10);
}

}  // namespace
}  // namespace l4d::io
