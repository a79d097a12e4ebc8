// SPDX-License-Identifier: Apache-2.0
// Files as this library and its tools write them (AtomicFile), and inputs that are no files.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

#include "io/file/file.h"
#include "libl4dcodec/base/atomic_file.h"
#include "tests/io/support.h"

namespace fs = std::filesystem;

namespace {

// What the file that is being written was called at its last fsync, and how many there were.
std::string g_watched;
std::atomic<int> g_syncs{0};
std::atomic<bool> g_watched_was_there{false};

}  // namespace

// In place of that of the C library, which this calls. What is asked of a disk cannot be seen
// otherwise.
extern "C" int fsync(int fd) {
  ++g_syncs;
  g_watched_was_there = !g_watched.empty() && fs::exists(g_watched);
  return static_cast<int>(::syscall(SYS_fsync, fd));
}

namespace l4d::io {
namespace {

class FilesTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("l4d-files-" + std::to_string(::getpid()));
    fs::create_directory(folder_);
    old_umask_ = ::umask(022);
  }
  void TearDown() override {
    ::umask(old_umask_);
    g_watched.clear();
    fs::remove_all(folder_);
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string put(const std::string& name, const std::string& text, mode_t mode = 0644) const {
    std::ofstream(path(name)) << text;
    ::chmod(path(name).c_str(), mode);
    return path(name);
  }
  std::string contents(const std::string& name) const {
    std::ifstream file(path(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }
  mode_t mode(const std::string& name) const {
    struct stat status {};
    EXPECT_EQ(::stat(path(name).c_str(), &status), 0) << name;
    return status.st_mode & 07777;
  }
  std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const auto& entry : fs::directory_iterator(folder_)) {
      all.push_back(entry.path().filename().string());
    }
    std::sort(all.begin(), all.end());
    return all;
  }
  void write(const std::string& name, const std::string& text) const {
    OutputFile file(path(name));
    file.write(text.data(), text.size());
    file.commit();
  }

  fs::path folder_;
  mode_t old_umask_ = 0;
};

using Names = std::vector<std::string>;

TEST_F(FilesTest, PermissionsAreThoseOfTheFileReplaced) {
  put("private", "old", 0600);
  put("shared", "old", 0664);
  put("tool", "old", 0750);
  for (const char* name : {"private", "shared", "tool", "fresh"}) write(name, "new");
  EXPECT_EQ(mode("private"), 0600U);
  EXPECT_EQ(mode("shared"), 0664U);
  EXPECT_EQ(mode("tool"), 0750U);
  EXPECT_EQ(mode("fresh"), 0644U);
  ::umask(077);
  write("secret", "new");
  EXPECT_EQ(mode("secret"), 0600U);
  EXPECT_EQ(contents("private"), "new");
}

// Half a file is nobody's business, whatever permissions it gets when it is whole.
TEST_F(FilesTest, NobodyElseReadsAnUnfinishedFile) {
  put("wide", "old", 0666);
  const OutputFile file(path("wide"));
  EXPECT_EQ(mode("wide.l4dtmp0"), 0600U);
}

TEST_F(FilesTest, TheOwnerStays) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root may give files away";
  put("theirs", "old", 0640);
  ASSERT_EQ(::chown(path("theirs").c_str(), 1234, 4321), 0);
  write("theirs", "new");
  struct stat status {};
  ASSERT_EQ(::stat(path("theirs").c_str(), &status), 0);
  EXPECT_EQ(status.st_uid, 1234U);
  EXPECT_EQ(status.st_gid, 4321U);
  EXPECT_EQ(status.st_mode & 07777U, 0640U);
}

TEST_F(FilesTest, WhatIsRenamedLiesOnTheDisk) {
  g_watched = path("a");
  g_syncs = 0;
  write("a", "new");
  EXPECT_EQ(g_syncs, 1);
  EXPECT_FALSE(g_watched_was_there);
}

// A process that is killed leaves a file, which the next one removes, and then writes its own.
TEST_F(FilesTest, TheFileOfADeadWriterGoes) {
  for (int k = 0; k < 3; ++k) {
    const pid_t child = ::fork();
    if (child == 0) {
      OutputFile file(path("a"));
      file.write("half", 4);
      ::raise(SIGKILL);
      ::_exit(1);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status));
    EXPECT_EQ(names(), Names{"a.l4dtmp0"}) << k;
  }
  put("a.l4dtmp7", "left by a dead eighth writer");
  put("b.l4dtmp0", "of another file");
  write("a", "whole");
  EXPECT_EQ(names(), (Names{"a", "b.l4dtmp0"}));
  EXPECT_EQ(contents("a"), "whole");
}

TEST_F(FilesTest, TheFileOfALivingWriterStays) {
  OutputFile first(path("a"));
  first.write("first", 5);
  {
    OutputFile second(path("a"));
    second.write("second", 6);
    EXPECT_EQ(names(), (Names{"a.l4dtmp0", "a.l4dtmp1"}));
    second.commit();
  }
  EXPECT_EQ(contents("a"), "second");
  write("a", "third");
  first.commit();
  EXPECT_EQ(names(), Names{"a"});
  EXPECT_EQ(contents("a"), "first");
}

// Many writers of one name, who all look for stale files all the time.
TEST_F(FilesTest, WritersAtTheSameTime) {
  std::vector<std::thread> threads;
  std::atomic<int> failures{0};
  for (char t = 'a'; t < 'e'; ++t) {
    threads.emplace_back([&, t] {
      for (int k = 0; k < 200; ++k) {
        try {
          write("x", std::string(1000, t));
        } catch (const Error&) {
          ++failures;
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(failures, 0);
  EXPECT_EQ(names(), Names{"x"});
  const std::string text = contents("x");
  EXPECT_EQ(text, std::string(1000, text.at(0)));
}

// What has such a name, but was not left by a writer of this user.
TEST_F(FilesTest, ForeignFilesStay) {
  fs::create_directory(path("a.l4dtmp0"));
  ASSERT_EQ(::mkfifo(path("a.l4dtmp1").c_str(), 0600), 0);
  put("elsewhere", "theirs");
  fs::create_symlink("elsewhere", path("a.l4dtmp2"));
  put("a.l4dtmp3", "theirs");
  Names want = {"a", "a.l4dtmp0", "a.l4dtmp1", "a.l4dtmp2", "elsewhere"};
  if (::geteuid() == 0 && ::chown(path("a.l4dtmp3").c_str(), 1234, 1234) == 0) {
    want.insert(want.begin() + 4, "a.l4dtmp3");
  }
  write("a", "mine");
  EXPECT_EQ(names(), want);
  EXPECT_EQ(contents("elsewhere"), "theirs");
}

TEST_F(FilesTest, LinksAreFollowed) {
  fs::create_directory(path("there"));
  fs::create_symlink("there/target", path("dangling"));
  fs::create_symlink("dangling", path("twice"));
  write("twice", "new");
  EXPECT_TRUE(fs::is_symlink(path("twice")));
  EXPECT_TRUE(fs::is_symlink(path("dangling")));
  EXPECT_EQ(contents("there/target"), "new");
  fs::create_symlink("round", path("round"));
  EXPECT_EQ(test::status_of([&] { OutputFile file(path("round")); }), L4D_ERR_IO);
  EXPECT_TRUE(fs::is_symlink(path("round")));
}

TEST_F(FilesTest, LongNames) {
  const std::string longest(255, 'x');
  write(longest, "new");
  // Cut within a character the temporary name would be no UTF-8.
  std::string umlauts;
  for (int i = 0; i < 127; ++i) umlauts += "\xc3\xa4";
  write(umlauts, "new");
  EXPECT_EQ(names(), (Names{longest, umlauts}));
  EXPECT_EQ(test::status_of([&] { OutputFile file(path(longest + 'x')); }), L4D_ERR_IO);
}

// Renaming over it would ask for the rights on the folder only. Root may write everything.
TEST_F(FilesTest, AReadOnlyFileIsNotReplaced) {
  put("kept", "old", 0444);
  ::chmod(folder_.c_str(), 0777);
  const bool is_root = ::geteuid() == 0;
  if (is_root) {
    ASSERT_EQ(::seteuid(65534), 0);
  }
  const l4d_status status = test::status_of([&] { OutputFile file(path("kept")); });
  if (is_root) {
    ASSERT_EQ(::seteuid(0), 0);
  }
  EXPECT_EQ(status, L4D_ERR_IO);
  EXPECT_EQ(names(), Names{"kept"});
}

// An open descriptor is written to where it stands.
TEST_F(FilesTest, DescriptorsAreWrittenInPlace) {
  const int fd = ::open(put("log", "one ").c_str(), O_WRONLY | O_APPEND);
  ASSERT_GE(fd, 0);
  const std::string name = "/dev/fd/" + std::to_string(fd);
  for (const char* text : {"two ", "three"}) {
    OutputFile file(name);
    file.write(text, std::char_traits<char>::length(text));
    file.commit();
  }
  EXPECT_EQ(::write(fd, ".", 1), 1);
  ::close(fd);
  EXPECT_EQ(contents("log"), "one two three.");
  EXPECT_EQ(names(), Names{"log"});
}

TEST_F(FilesTest, AnonymousFilesHaveNoName) {
  const FileHandle file = anonymous_file();
  {
    OutputFile output(path_of(file));
    output.write("text", 4);
    output.commit();
  }
  struct stat status {};
  ASSERT_EQ(::fstat(::fileno(file.get()), &status), 0);
  EXPECT_EQ(status.st_nlink, 0U);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
  std::rewind(file.get());
  char text[5] = {};
  EXPECT_EQ(std::fread(text, 1, 4, file.get()), 4U);
  EXPECT_STREQ(text, "text");
}

TEST_F(FilesTest, FilesAreToldApartByWhatTheyAre) {
  put("a", "a");
  fs::create_directory(path("d"));
  fs::create_hard_link(path("a"), path("hard"));
  fs::create_symlink("a", path("soft"));
  fs::create_symlink("d", path("e"));
  fs::create_symlink("d/new", path("dangling"));
  const auto id = [&](const std::string& name) {
    const std::optional<FileId> found = identify(path(name));
    return found ? std::to_string(found->inode) + "/" + found->name : "";
  };
  EXPECT_NE(id("a"), "");
  for (const char* same : {"hard", "soft", "d/../a", "./a"}) EXPECT_EQ(id(same), id("a")) << same;
  EXPECT_NE(id("d/a"), id("a"));
  for (const char* same : {"e/new", "d/./new", "dangling", "d/../e/new"}) {
    EXPECT_EQ(id(same), id("d/new")) << same;
  }
  EXPECT_NE(id("d/new"), id("new"));
  EXPECT_EQ(id("no/such"), "");
  EXPECT_FALSE(identify("/dev/null").has_value());
}

// ---- inputs -------------------------------------------------------------------------------------

TEST_F(FilesTest, APipeThatNobodyWritesToIsRefused) {
  ASSERT_EQ(::mkfifo(path("pipe").c_str(), 0600), 0);
  EXPECT_EQ(test::status_of([&] { InputFile file(path("pipe")); }), L4D_ERR_IO);
}

TEST_F(FilesTest, APipeIsReadToItsEnd) {
  ASSERT_EQ(::mkfifo(path("pipe").c_str(), 0600), 0);
  const std::string text(300000, 'x');
  std::thread writer([&] {
    // Later than the reader, and with a pause.
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    std::ofstream pipe(path("pipe"));
    pipe << text.substr(0, 1000) << std::flush;
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    pipe << text.substr(1000);
  });
  EXPECT_EQ(read_whole_file(path("pipe")).size(), text.size());
  writer.join();
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  ::close(ends[1]);
  EXPECT_EQ(read_whole_file("/dev/fd/" + std::to_string(ends[0])).size(), 0U);
  ::close(ends[0]);
}

TEST_F(FilesTest, DevicesAreNoInput) {
  EXPECT_EQ(test::status_of([&] { InputFile file("/dev/zero"); }), L4D_ERR_IO);
  EXPECT_EQ(test::status_of([&] { InputFile file(folder_.string()); }), L4D_ERR_IO);
}

TEST_F(FilesTest, AGrowingFileAppearsWithItsFirstBytesAndHasOneWriter) {
  put("old", "old", 0640);
  {
    GrowingFile file(path("old"));
    EXPECT_EQ(contents("old"), "old");
    EXPECT_THROW(GrowingFile(path("old")), Error);
    file.append("abc", 3);
    EXPECT_EQ(contents("old"), "abc");
    EXPECT_EQ(mode("old"), 0640u);
    EXPECT_THROW(GrowingFile(path("old")), Error);
    EXPECT_EQ(contents("old"), "abc");
    file.append("de", 2);
    EXPECT_EQ(file.size(), 5u);
    // What is renamed over it is not written to, nor is what was.
    put("other", "other");
    fs::rename(path("other"), path("old"));
    EXPECT_THROW(file.append("f", 1), Error);
    EXPECT_EQ(contents("old"), "other");
  }
  { const GrowingFile none(path("old")); }
  EXPECT_EQ(contents("old"), "other");
  EXPECT_EQ(names(), std::vector<std::string>{"old"});
}

}  // namespace
}  // namespace l4d::io
