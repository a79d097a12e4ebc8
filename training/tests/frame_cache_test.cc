// SPDX-License-Identifier: Apache-2.0
#include "training/images/frame_cache.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <map>
#include <mutex>
#include <thread>

#include "io/image/video.h"
#include "tests/common/ffmpeg.h"
#include "training/images/loader.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using testing::HasSubstr;

// 4 cameras of 12 frames, of which 3 train: a cache has two files of each.
class FrameCaches : public testing::Test {
 protected:
  void SetUp() override {
    if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
    // A copy, which a case may change; making the videos takes longer than the case.
    static const Folder made;
    const std::string whole = made / "capture";
    if (!fs::exists(whole)) test::render_videos(whole);
    path_ = folder_ / "capture";
    fs::copy(whole, path_, fs::copy_options::recursive);
    capture_ = read_capture(path_, {});
    for (uint32_t k = 0; k < capture_.views.size(); ++k) views_.push_back(k);
    cache_path_ = folder_ / "cache";
    key_ = FrameCache::key_of(capture_, 0.5);
  }
  // All views of the videos, as they are without a cache.
  const std::map<uint32_t, std::vector<uint8_t>>& whole_capture() const {
    static const auto whole = load(ImageLoader(capture_, 0.5), views_);
    return whole;
  }
  static std::map<uint32_t, std::vector<uint8_t>> load(const ImageLoader& loader,
                                                       const std::vector<uint32_t>& views) {
    std::map<uint32_t, std::vector<uint8_t>> out;
    std::mutex mutex;
    loader.load(views, 2, [&](uint32_t view, Pixels pixels) {
      const std::lock_guard<std::mutex> lock(mutex);
      out[view] = std::move(pixels.rgb);
    });
    return out;
  }
  std::vector<std::string> files() const {
    std::vector<std::string> out;
    if (!fs::exists(cache_path_)) return out;
    for (const auto& entry : fs::recursive_directory_iterator(cache_path_)) {
      if (entry.is_regular_file()) out.push_back(entry.path().string());
    }
    std::sort(out.begin(), out.end());
    return out;
  }
  uint64_t bytes() const {
    uint64_t total = 0;
    for (const std::string& file : files()) total += fs::file_size(file);
    return total;
  }

  Folder folder_;
  std::string path_, cache_path_, key_;
  Capture capture_;
  std::vector<uint32_t> views_;
};

constexpr uint64_t kLarge = 1 << 20;
constexpr uint64_t kFileBytes = 96 + uint64_t{8} * 32 * 24 * 3;  // of 8 frames at half the size

TEST_F(FrameCaches, KeepFramesOfVideos) {
  const auto& whole = whole_capture();
  ASSERT_EQ(whole.size(), 48U);
  FrameCache cache(cache_path_, key_, kLarge);
  ImageLoader loader(capture_, 0.5);
  loader.use(&cache);
  // One view of a second part: all of the part is kept, and that view alone is returned.
  const uint32_t late = views_[4 * 9 + 1];
  ASSERT_EQ(capture_.views[late].camera, 1U);
  EXPECT_EQ(load(loader, {late}),
            (std::map<uint32_t, std::vector<uint8_t>>{{late, whole.at(late)}}));
  EXPECT_EQ(files(), std::vector<std::string>{cache_path_ + "/" + key_ + "/1-1.frames"});
  EXPECT_TRUE(cache.has({1, 1, 4, 32, 24}));
  EXPECT_FALSE(cache.has({1, 1, 8, 32, 24}));
  EXPECT_FALSE(cache.has({1, 1, 4, 24, 32}));

  // The rest of the training views: 5 files, decoded once.
  uint64_t last = 0, total = 0;
  const auto progress = [&](uint64_t done, uint64_t of) {
    last = done;
    total = of;
    return false;
  };
  loader.fill_cache("train", 2, progress);
  EXPECT_EQ(last, 32U);
  EXPECT_EQ(total, 32U);
  EXPECT_EQ(files().size(), 6U);
  EXPECT_TRUE(load(loader, views_) == whole);
  EXPECT_EQ(files().size(), 8U);
  EXPECT_EQ(bytes(), 4 * (kFileBytes + 96 + uint64_t{4} * 32 * 24 * 3));

  const std::vector<FrameCache::Content> list = FrameCache::list(cache_path_, capture_);
  ASSERT_EQ(list.size(), 1U);
  EXPECT_EQ(list[0].scale, 0.5);
  EXPECT_EQ(list[0].bytes, bytes());

  // Without videos: frames are read in any order, and one by one.
  for (uint32_t c = 0; c < 4; ++c) fs::remove(path_ + "/cam0" + std::to_string(c) + ".mp4");
  EXPECT_TRUE(load(loader, views_) == whole);
  EXPECT_EQ(load(loader, {late}).at(late), whole.at(late));
  EXPECT_TRUE(cache.is_writable());
  EXPECT_EQ(cache.trouble(), "");
}

// A cancelled fill ends between two frames, and what it kept is right.
TEST_F(FrameCaches, FillsAreCancelled) {
  const auto& whole = whole_capture();
  FrameCache cache(cache_path_, key_, kLarge);
  ImageLoader loader(capture_, 0.5);
  loader.use(&cache);
  try {
    loader.fill_cache("train", 1, [](uint64_t done, uint64_t) { return done == 10; });
    FAIL();
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_CANCELLED);
  }
  EXPECT_EQ(files().size(), 1U);
  EXPECT_TRUE(load(loader, views_) == whole);
}

TEST_F(FrameCaches, DamagedFilesAreMadeAnew) {
  const auto& whole = whole_capture();
  FrameCache cache(cache_path_, key_, kLarge);
  ImageLoader loader(capture_, 0.5);
  loader.use(&cache);
  EXPECT_TRUE(load(loader, views_) == whole);
  const std::string damaged = cache_path_ + "/" + key_ + "/1-0.frames";
  const std::string bytes = test::bytes_of(damaged), video = path_ + "/cam01.mp4";
  ASSERT_EQ(bytes.size(), kFileBytes);

  // Without the video, what is damaged cannot be decoded again.
  fs::rename(video, path_ + "/gone.mp4");
  std::vector<std::string> wrong = {bytes.substr(0, bytes.size() - 1), bytes + "x", ""};
  for (const size_t place : {size_t{0}, size_t{9}, size_t{40}, size_t{96}, bytes.size() - 1}) {
    wrong.push_back(bytes);
    wrong.back()[place] = static_cast<char>(bytes[place] ^ 1);
  }
  for (size_t k = 0; k < wrong.size(); ++k) {
    std::ofstream(damaged, std::ios::binary) << wrong[k];
    EXPECT_THROW(load(loader, views_), io::Error) << k;
  }
  fs::rename(path_ + "/gone.mp4", video);
  EXPECT_TRUE(load(loader, views_) == whole);
  EXPECT_TRUE(test::bytes_of(damaged) == bytes);
}

// A capture that changed in the middle of a video, or whose frames are others, has another key.
TEST_F(FrameCaches, KeysTellCapturesApart) {
  const std::string video = path_ + "/cam02.mp4", bytes = test::bytes_of(video);
  EXPECT_NE(FrameCache::key_of(capture_, 0.25), key_);
  CaptureOptions options;
  options.frames = "0:12:2";
  EXPECT_NE(FrameCache::key_of(read_capture(path_, options), 0.5), key_);
  // Larger than the ends that other hashes look at.
  const std::string rest(300 << 10, 'x');
  std::ofstream(video, std::ios::binary) << bytes << rest;
  const std::string longer = FrameCache::key_of(capture_, 0.5);
  std::string changed = rest;
  changed[changed.size() / 2] = 'y';
  std::ofstream(video, std::ios::binary) << bytes << changed;
  EXPECT_NE(FrameCache::key_of(capture_, 0.5), longer);
  EXPECT_NE(longer, key_);
  std::ofstream(video, std::ios::binary) << bytes;
  EXPECT_EQ(FrameCache::key_of(capture_, 0.5), key_);
}

// Files of other captures count, and files of others do not.
TEST_F(FrameCaches, StayWithinTheirLimit) {
  const auto& whole = whole_capture();
  FrameCache other(cache_path_, "frames1-other-0.5", kLarge);
  ImageLoader loader(capture_, 0.5);
  loader.use(&other);
  EXPECT_TRUE(load(loader, views_) == whole);
  const uint64_t before = bytes();
  fs::create_directories(cache_path_ + "/music");
  const std::string foreign(kLarge, 'x');
  std::ofstream(cache_path_ + "/music/1-0.frames") << foreign;
  std::ofstream(cache_path_ + "/notes.frames") << foreign;

  FrameCache cache(cache_path_, key_, before + 3 * kFileBytes);
  loader.use(&cache);
  loader.fill_cache("train", 1, nullptr);
  EXPECT_FALSE(cache.is_writable());
  EXPECT_THAT(cache.trouble(), HasSubstr("--cache-limit"));
  EXPECT_LE(bytes() - 2 * kLarge, before + 3 * kFileBytes);
  EXPECT_GT(bytes() - 2 * kLarge, before + kFileBytes);
  EXPECT_TRUE(load(loader, views_) == whole);
  EXPECT_TRUE(test::bytes_of(cache_path_ + "/notes.frames") == foreign);
  EXPECT_TRUE(test::bytes_of(cache_path_ + "/music/1-0.frames") == foreign);
}

// A cache that cannot be written is none, and says why.
TEST_F(FrameCaches, ThatCannotBeWrittenSayWhy) {
  const auto& whole = whole_capture();
  std::ofstream(folder_ / "file") << "x";
  for (const std::string& path : {folder_ / "file", folder_ / "file/inside"}) {
    FrameCache cache(path, key_, kLarge);
    ImageLoader loader(capture_, 0.5);
    loader.use(&cache);
    loader.fill_cache("train", 2, nullptr);
    EXPECT_TRUE(load(loader, views_) == whole);
    EXPECT_FALSE(cache.is_writable());
    EXPECT_THAT(cache.trouble(), HasSubstr("cannot make the folder"));
  }
  EXPECT_EQ(test::bytes_of(folder_ / "file"), "x");
}

// Two trainings that begin together read what either of them wrote.
TEST_F(FrameCaches, AreShared) {
  const auto& whole = whole_capture();
  for (int repeat = 0; repeat < 2; ++repeat) {
    fs::remove_all(cache_path_);
    std::vector<std::thread> trainings;
    std::array<bool, 2> right{};
    for (size_t t = 0; t < right.size(); ++t) {
      trainings.emplace_back([&, t] {
        FrameCache cache(cache_path_, key_, kLarge);
        ImageLoader loader(capture_, 0.5);
        loader.use(&cache);
        loader.fill_cache("train", 2, nullptr);
        right[t] = load(loader, views_) == whole && cache.is_writable();
      });
    }
    for (std::thread& training : trainings) training.join();
    EXPECT_TRUE(right[0]);
    EXPECT_TRUE(right[1]);
    EXPECT_EQ(files().size(), 8U);  // and no temporary file
  }
}

// The same bits without a cache, with an empty and a full one, and where a training that had none
// goes on with one, or the other way round.
TEST_F(FrameCaches, ChangeNoBitOfATraining) {
  io::SynthOptions synth;
  synth.seconds = 4;
  synth.fps = 10;
  synth.gaussians = 300;
  synth.seed = 7;
  RenderCaptureOptions videos;
  videos.cameras = 4;
  videos.width = 64;
  videos.height = 48;
  videos.format = "mp4";
  render_capture(folder_ / "long", io::synthesize(synth), videos);
  RunOptions options = test::tiny_run(folder_ / "without", 64);
  options.settings.capture = folder_ / "long";
  options.settings.gaussians = 200;
  options.settings.scale = 0.5;
  // Four windows of the five, of which the oldest goes after each 48 steps.
  options.settings.host_memory = uint64_t{4} * 24 * 32 * 24 * 4;
  test::Listener listener;
  train(options, &listener);
  const std::string scene = test::bytes_of(options.folder + "/scene.ply");
  ASSERT_FALSE(scene.empty());
  options.cache = cache_path_;
  for (const std::string name : {"cold", "warm"}) {
    options.folder = folder_ / name;
    train(options, &listener);
    EXPECT_TRUE(test::bytes_of(options.folder + "/scene.ply") == scene) << name;
  }
  EXPECT_EQ(files().size(), 20U);  // 4 cameras of 40 frames
  for (const bool begins_with_cache : {true, false}) {
    options.folder = folder_ / (begins_with_cache ? "first" : "second");
    options.cache = begins_with_cache ? cache_path_ : "";
    options.resume = false;
    test::Listener first(54);
    EXPECT_THROW(train(options, &first), io::Error);
    options.cache = begins_with_cache ? "" : cache_path_;
    options.resume = true;
    train(options, &listener);
    EXPECT_TRUE(test::bytes_of(options.folder + "/scene.ply") == scene);
  }
}

}  // namespace
}  // namespace l4d::train
