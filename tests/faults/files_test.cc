// SPDX-License-Identifier: Apache-2.0
// Files: full disks, cancelling, links and devices. Nothing half-written is left, and what was
// there before stays.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;
namespace fs = std::filesystem;

Bytes contents(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return Bytes(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
}

// An empty folder, and an encoder with a small scene.
class Files : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = temporary_path("-folder");
    fs::create_directory(folder_);
    SceneOptions s;
    s.count = 300;
    s.num_frames = 4;
    scene_ = make_scene(s);
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 4});
    prepare_encoder(scene_, o, encoder_);
    want_ = encoder_.encode();
    ASSERT_GT(want_.size(), 3000u);
  }
  void TearDown() override { fs::remove_all(folder_); }

  l4d_status encode_to(const fs::path& path) const {
    return l4d_encoder_encode_file(encoder_.get(), path.c_str());
  }
  std::string detail() const { return l4d_last_error_message(); }
  std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const auto& entry : fs::directory_iterator(folder_)) {
      all.push_back(entry.path().filename().string());
    }
    std::sort(all.begin(), all.end());
    return all;
  }
  fs::path put(const char* name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }

  fs::path folder_;
  TestScene scene_;
  const l4d_encoder_options options_ = one_thread();
  EncoderHandle encoder_{&options_};
  Bytes want_;
};

using Names = std::vector<std::string>;

TEST_F(Files, AnOutputAppearsWhole) {
  ASSERT_EQ(encode_to(folder_ / "a.l4d"), L4D_OK);
  EXPECT_EQ(contents(folder_ / "a.l4d"), want_);
  put("b.l4d", "old");
  ASSERT_EQ(encode_to(folder_ / "b.l4d"), L4D_OK);
  EXPECT_EQ(contents(folder_ / "b.l4d"), want_);
  EXPECT_EQ(names(), (Names{"a.l4d", "b.l4d"}));
}

// The limit on the size of files stands for a disk that fills up, at any place in the file.
TEST_F(Files, ADiskThatFillsUp) {
  struct rlimit before {};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  const fs::path old_file = put("old.l4d", "as it was");
  for (size_t size = 0; size < want_.size(); size += 1 + want_.size() / 40) {
    struct rlimit small = before;
    small.rlim_cur = size;
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
    const l4d_status fresh = encode_to(folder_ / "new.l4d");
    const std::string fresh_detail = detail();
    const l4d_status over = encode_to(old_file);
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
    EXPECT_EQ(fresh, L4D_ERR_IO) << size;
    EXPECT_NE(fresh_detail.find("new.l4d"), std::string::npos) << fresh_detail;
    EXPECT_NE(fresh_detail.find("File too large"), std::string::npos) << fresh_detail;
    EXPECT_EQ(over, L4D_ERR_IO) << size;
    ASSERT_EQ(names(), Names{"old.l4d"}) << size;
    ASSERT_EQ(contents(old_file).size(), 9u);
  }
  std::signal(SIGXFSZ, old_handler);
  ASSERT_EQ(encode_to(old_file), L4D_OK);
  EXPECT_EQ(contents(old_file), want_);
}

TEST_F(Files, DevicesAreWrittenInPlace) {
  if (::access("/dev/full", W_OK) != 0) GTEST_SKIP() << "no /dev/full";
  EXPECT_EQ(encode_to("/dev/full"), L4D_ERR_IO);
  EXPECT_NE(detail().find("No space left"), std::string::npos) << detail();
  EXPECT_TRUE(fs::is_character_file("/dev/full"));
  EXPECT_EQ(encode_to("/dev/null"), L4D_OK) << detail();
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
  // The same through a link to one.
  fs::create_symlink("/dev/null", folder_ / "link");
  EXPECT_EQ(encode_to(folder_ / "link"), L4D_OK) << detail();
  EXPECT_TRUE(fs::is_symlink(folder_ / "link"));
}

TEST_F(Files, ALinkStaysOne) {
  fs::create_directory(folder_ / "there");
  std::ofstream(folder_ / "there" / "target.l4d") << "old";
  fs::create_symlink("there/target.l4d", folder_ / "link.l4d");
  ASSERT_EQ(encode_to(folder_ / "link.l4d"), L4D_OK) << detail();
  EXPECT_TRUE(fs::is_symlink(folder_ / "link.l4d"));
  EXPECT_EQ(contents(folder_ / "there" / "target.l4d"), want_);
  EXPECT_EQ(names(), (Names{"link.l4d", "there"}));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "there"), fs::directory_iterator()), 1);
}

TEST_F(Files, PlacesThatCannotBeWritten) {
  EXPECT_EQ(encode_to(folder_ / "no" / "such.l4d"), L4D_ERR_IO);
  EXPECT_NE(detail().find("No such file"), std::string::npos) << detail();
  EXPECT_EQ(encode_to(folder_), L4D_ERR_IO);
  EXPECT_NE(detail().find("directory"), std::string::npos) << detail();
  EXPECT_TRUE(names().empty());
}

// Another writer's file of the temporary name is not touched, nor is that of another program.
TEST_F(Files, ForeignTemporariesStay) {
  const fs::path foreign = put("a.l4d.l4dtmp0", "theirs");
  const int writer = ::open(foreign.c_str(), O_WRONLY);
  ASSERT_EQ(::flock(writer, LOCK_EX), 0);
  put("a.l4d.tmp", "theirs");
  ASSERT_EQ(encode_to(folder_ / "a.l4d"), L4D_OK) << detail();
  EXPECT_EQ(names(), (Names{"a.l4d", "a.l4d.l4dtmp0", "a.l4d.tmp"}));
  EXPECT_EQ(contents(foreign).size(), 6u);
  ::close(writer);
}

// What a writer left that was killed goes with the next file of that name.
TEST_F(Files, StaleTemporariesGo) {
  put("a.l4d.l4dtmp0", "half of a stream");
  put("a.l4d.l4dtmp3", "half of another");
  ASSERT_EQ(encode_to(folder_ / "a.l4d"), L4D_OK) << detail();
  EXPECT_EQ(names(), Names{"a.l4d"});
}

TEST_F(Files, PermissionsAreThoseOfTheFileReplaced) {
  const fs::path secret = put("a.l4d", "old");
  fs::permissions(secret, fs::perms::owner_read | fs::perms::owner_write);
  ASSERT_EQ(encode_to(secret), L4D_OK) << detail();
  EXPECT_EQ(fs::status(secret).permissions(), fs::perms::owner_read | fs::perms::owner_write);
}

TEST_F(Files, ALinkThatLeadsNowhereIsFollowed) {
  fs::create_symlink("target.l4d", folder_ / "link.l4d");
  ASSERT_EQ(encode_to(folder_ / "link.l4d"), L4D_OK) << detail();
  EXPECT_TRUE(fs::is_symlink(folder_ / "link.l4d"));
  EXPECT_EQ(contents(folder_ / "target.l4d"), want_);
}

struct Stop {
  int at;
  int calls = 0;
  static int callback(void* user, uint64_t, uint64_t, const char*) {
    Stop& self = *static_cast<Stop*>(user);
    return self.calls++ == self.at;
  }
};

TEST_F(Files, CancellingLeavesNothing) {
  const fs::path old_file = put("old.l4d", "as it was");
  Stop count{-1};
  l4d_encoder_set_progress(encoder_.get(), &Stop::callback, &count);
  ASSERT_EQ(encode_to("/dev/null"), L4D_OK);
  for (int k = 0; k < count.calls; k += 1 + count.calls / 60) {
    Stop stop{k};
    l4d_encoder_set_progress(encoder_.get(), &Stop::callback, &stop);
    ASSERT_EQ(encode_to(k % 2 == 0 ? old_file : folder_ / "new.l4d"), L4D_ERR_CANCELLED) << k;
    ASSERT_EQ(names(), Names{"old.l4d"}) << k;
    ASSERT_EQ(contents(old_file).size(), 9u);
  }
}

// ---- decoding from files ------------------------------------------------------------------------

TEST_F(Files, FilesThatCannotBeRead) {
  const DecoderHandle d;
  EXPECT_EQ(l4d_decoder_open_file(d.get(), (folder_ / "none.l4d").c_str()), L4D_ERR_IO);
  EXPECT_EQ(l4d_decoder_open_file(d.get(), folder_.c_str()), L4D_ERR_IO);
  EXPECT_EQ(l4d_decoder_open_file(d.get(), "/dev/null"), L4D_ERR_IO);
  // Nobody writes to it, and nobody waits for that.
  ASSERT_EQ(::mkfifo((folder_ / "pipe.l4d").c_str(), 0600), 0);
  EXPECT_EQ(l4d_decoder_open_file(d.get(), (folder_ / "pipe.l4d").c_str()), L4D_ERR_IO);
  put("empty.l4d", "");
  EXPECT_EQ(l4d_decoder_open_file(d.get(), (folder_ / "empty.l4d").c_str()), L4D_ERR_NOT_L4D);
}

size_t open_files() {
  const fs::directory_iterator begin("/proc/self/fd"), end;
  return static_cast<size_t>(std::distance(begin, end));
}

TEST_F(Files, HandlesAreClosed) {
  if (!fs::exists("/proc/self/fd")) GTEST_SKIP() << "no /proc";
  const fs::path path = folder_ / "a.l4d";
  ASSERT_EQ(encode_to(path), L4D_OK);
  const size_t before = open_files();
  {
    const DecoderHandle d;
    for (int i = 0; i < 3; ++i) ASSERT_EQ(l4d_decoder_open_file(d.get(), path.c_str()), L4D_OK);
    EXPECT_EQ(open_files(), before + 1);
    // Another stream closes the one before, and so does one that cannot be opened.
    ASSERT_EQ(l4d_decoder_open_memory(d.get(), want_.data(), want_.size()), L4D_OK);
    EXPECT_EQ(open_files(), before);
    ASSERT_EQ(l4d_decoder_open_file(d.get(), path.c_str()), L4D_OK);
    EXPECT_NE(l4d_decoder_open_file(d.get(), "/dev/null"), L4D_OK);
    EXPECT_EQ(open_files(), before);
    ASSERT_EQ(l4d_decoder_open_file(d.get(), path.c_str()), L4D_OK);
  }
  EXPECT_EQ(open_files(), before);
}

// A file that is cut while it is open.
TEST_F(Files, ShrinkingUnderTheReader) {
  const fs::path path = folder_ / "a.l4d";
  ASSERT_EQ(encode_to(path), L4D_OK);
  DecoderHandle d;
  d.open_file(path.string());
  fs::resize_file(path, want_.size() / 2);
  const l4d_query q = all_query();
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.capacity = d.info().num_gaussians;
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_ERR_IO);
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(want_.data()),
             static_cast<std::streamsize>(want_.size()));
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_OK);
}

}  // namespace
}  // namespace l4d
