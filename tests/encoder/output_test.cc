// SPDX-License-Identifier: Apache-2.0
// Files appear whole or not at all: cancelling, failing writers, unwritable places.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;
namespace fs = std::filesystem;

Bytes read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return Bytes(std::istreambuf_iterator<char>(in), {});
}

class EncodeFile : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = temporary_path("-folder");
    fs::create_directory(folder_);
    path_ = folder_ + "/scene.l4d";
    SceneOptions s;
    s.count = 200;
    s.sh_degree = 0;
    s.num_frames = 8;
    scene_ = make_scene(s);
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_MERGE_COUNT, 20});
    o.settings.push_back({L4D_ENC_KMEANS_ITERATIONS, 2});
    prepare_encoder(scene_, o, encoder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  size_t files() const {
    return static_cast<size_t>(
        std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  std::string folder_, path_;
  TestScene scene_;
  const l4d_encoder_options options_ = one_thread();
  EncoderHandle encoder_{&options_};
};

TEST_F(EncodeFile, IsWhatTheWriterGets) {
  ASSERT_EQ(l4d_encoder_encode_file(encoder_.get(), path_.c_str()), L4D_OK);
  EXPECT_TRUE(read_file(path_) == encoder_.encode());
  EXPECT_EQ(files(), 1u);
  // Again, over the old one.
  ASSERT_EQ(l4d_encoder_encode_file(encoder_.get(), path_.c_str()), L4D_OK);
  EXPECT_EQ(files(), 1u);
  DecoderHandle d;
  d.open_file(path_);
  EXPECT_EQ(d.info().num_gaussians, 200u);
}

struct Canceller {
  int calls = 0;
  int at = -1;
  int writes = 0;
  uint64_t last_done = 0, total = 0;
  bool wrong = false;
};
int on_progress(void* user, uint64_t done, uint64_t total, const char* stage) {
  Canceller& c = *static_cast<Canceller*>(user);
  if (stage == nullptr || stage[0] == '\0' || done > total || done < c.last_done) c.wrong = true;
  c.last_done = done;
  c.total = total;
  c.writes += stage != nullptr && std::string(stage) == "write" ? 1 : 0;
  return c.calls++ == c.at ? 1 : 0;
}

TEST_F(EncodeFile, ProgressGoesForward) {
  Canceller c;
  ASSERT_EQ(l4d_encoder_set_progress(encoder_.get(), on_progress, &c), L4D_OK);
  ASSERT_EQ(l4d_encoder_encode_file(encoder_.get(), path_.c_str()), L4D_OK);
  EXPECT_GT(c.calls, 5);
  EXPECT_FALSE(c.wrong);
  EXPECT_EQ(c.last_done, c.total);
}

// Compressing pages is most of a lossless encode.
TEST_F(EncodeFile, AsksBeforeEachPage) {
  encoder_.check(l4d_encoder_set_preset(encoder_.get(), "lossless"));
  encoder_.set(L4D_ENC_PAGE_SIZE, 64);
  Canceller c;
  ASSERT_EQ(l4d_encoder_set_progress(encoder_.get(), on_progress, &c), L4D_OK);
  int chunks = 0;
  l4d_writer w = L4D_INIT(l4d_writer);
  w.user = &chunks;
  w.write = [](void* user, const void*, size_t) { return 0 * ++*static_cast<int*>(user); };
  ASSERT_EQ(l4d_encoder_encode(encoder_.get(), &w), L4D_OK);
  // It asks before each chunk, and as each of two steps begins.
  constexpr int kPages = 2;
  EXPECT_GE(c.writes, chunks + 2 + kPages) << chunks;
}

// A nonzero return cancels, whichever call it is and though it is given once.
TEST_F(EncodeFile, CancelledAtEveryPointLeavesNoFile) {
  Canceller count;
  ASSERT_EQ(l4d_encoder_set_progress(encoder_.get(), on_progress, &count), L4D_OK);
  const Bytes want = encoder_.encode();
  for (int k = 0; k < count.calls; ++k) {
    Canceller c;
    c.at = k;
    ASSERT_EQ(l4d_encoder_set_progress(encoder_.get(), on_progress, &c), L4D_OK);
    EXPECT_EQ(l4d_encoder_encode_file(encoder_.get(), path_.c_str()), L4D_ERR_CANCELLED)
        << "call " << k << " of " << count.calls;
    EXPECT_EQ(files(), 0u) << "call " << k;
    fs::remove(path_);
  }
  ASSERT_EQ(l4d_encoder_set_progress(encoder_.get(), nullptr, nullptr), L4D_OK);
  EXPECT_TRUE(encoder_.encode() == want);
}

TEST_F(EncodeFile, CancellingKeepsTheOldFile) {
  ASSERT_EQ(l4d_encoder_encode_file(encoder_.get(), path_.c_str()), L4D_OK);
  const Bytes old = read_file(path_);
  Canceller c;
  c.at = 0;
  ASSERT_EQ(l4d_encoder_set_progress(encoder_.get(), on_progress, &c), L4D_OK);
  EXPECT_EQ(l4d_encoder_encode_file(encoder_.get(), path_.c_str()), L4D_ERR_CANCELLED);
  EXPECT_TRUE(read_file(path_) == old);
  EXPECT_EQ(files(), 1u);
}

TEST_F(EncodeFile, FailingWritersEndTheEncode) {
  struct Writer {
    int calls = 0;
    int fail_at = -1;
  } count;
  const auto write = [](void* user, const void*, size_t) -> int {
    Writer& w = *static_cast<Writer*>(user);
    return w.calls++ == w.fail_at ? 1 : 0;
  };
  l4d_writer w = L4D_INIT(l4d_writer);
  w.user = &count;
  w.write = write;
  ASSERT_EQ(l4d_encoder_encode(encoder_.get(), &w), L4D_OK);
  ASSERT_GT(count.calls, 3);
  for (int k = 0; k < count.calls; ++k) {
    Writer bad;
    bad.fail_at = k;
    w.user = &bad;
    EXPECT_EQ(l4d_encoder_encode(encoder_.get(), &w), L4D_ERR_IO) << k;
    EXPECT_EQ(bad.calls, k + 1) << "written on after a failure";
  }
  w.write = nullptr;
  EXPECT_EQ(l4d_encoder_encode(encoder_.get(), &w), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_encode(encoder_.get(), nullptr), L4D_ERR_INVALID_ARGUMENT);
}

TEST_F(EncodeFile, UnwritablePlaces) {
  EXPECT_EQ(l4d_encoder_encode_file(encoder_.get(), (folder_ + "/none/scene.l4d").c_str()),
            L4D_ERR_IO);
  EXPECT_NE(std::string(l4d_last_error_message()).find("/none/scene.l4d"), std::string::npos);
  // A folder of that name is in the way.
  fs::create_directory(path_);
  EXPECT_EQ(l4d_encoder_encode_file(encoder_.get(), path_.c_str()), L4D_ERR_IO);
  EXPECT_EQ(files(), 1u);
  EXPECT_EQ(l4d_encoder_encode_file(encoder_.get(), nullptr), L4D_ERR_INVALID_ARGUMENT);
}

TEST_F(EncodeFile, WithoutASceneThereIsNothingToEncode) {
  const EncoderHandle empty;
  EXPECT_EQ(l4d_encoder_encode_file(empty.get(), path_.c_str()), L4D_ERR_INVALID_STATE);
  EXPECT_EQ(files(), 0u);
}

}  // namespace
}  // namespace l4d
