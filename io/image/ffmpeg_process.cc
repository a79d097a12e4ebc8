// SPDX-License-Identifier: Apache-2.0
#include "io/image/ffmpeg_process.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <system_error>

extern char** environ;

namespace l4d::io {
namespace {

std::string words_of(int error) { return std::generic_category().message(error); }

class SpawnSetup {
 public:
  SpawnSetup() {
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
    // Where the caller ignores SIGPIPE the child would inherit that, and outlive its reader.
    sigset_t defaults;
    sigemptyset(&defaults);
    sigaddset(&defaults, SIGPIPE);
    posix_spawnattr_setsigdefault(&attributes, &defaults);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
  }
  ~SpawnSetup() {
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
  }
  SpawnSetup(const SpawnSetup&) = delete;
  SpawnSetup& operator=(const SpawnSetup&) = delete;

  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
};

class FileDescriptor {
 public:
  explicit FileDescriptor(int fd) : fd_(fd) {}
  ~FileDescriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  int get() const { return fd_; }
  int release() {
    const int fd = fd_;
    fd_ = -1;
    return fd;
  }

 private:
  int fd_;
};

}  // namespace

FfmpegProcess::FfmpegProcess(const std::string& subject, const std::vector<std::string>& arguments,
                             Direction direction, std::FILE* extra)
    : subject_(subject) {
  const auto fail = [&](const char* action, int error) {
    throw Error(L4D_ERR_IO, subject + ": " + action + ": " + words_of(error));
  };
  // A file, for a pipe that nobody reads would block ffmpeg when it is full.
  errors_ = anonymous_file();
  // A socket and not a pipe: sending to one whose reader is gone need not raise SIGPIPE.
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
    fail("cannot make a pair of sockets", errno);
  }
  FileDescriptor ours(ends[0]), theirs(ends[1]);

  SpawnSetup setup;
  const bool is_output = direction == Direction::kFrom;
  const int used = is_output ? STDOUT_FILENO : STDIN_FILENO;
  const int unused = is_output ? STDIN_FILENO : STDOUT_FILENO;
  posix_spawn_file_actions_adddup2(&setup.actions, theirs.get(), used);
  posix_spawn_file_actions_addopen(&setup.actions, unused, "/dev/null", O_RDWR, 0);
  posix_spawn_file_actions_adddup2(&setup.actions, ::fileno(errors_.get()), STDERR_FILENO);

  if (extra != nullptr) {
    posix_spawn_file_actions_adddup2(&setup.actions, ::fileno(extra), kExtra);
  }

  std::vector<std::string> words = {"ffmpeg", "-nostdin", "-hide_banner", "-loglevel", "error"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  argv.reserve(words.size() + 1);
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  const int error =
      posix_spawnp(&pid_, "ffmpeg", &setup.actions, &setup.attributes, argv.data(), environ);
  if (error != 0) {
    pid_ = -1;
    if (error == ENOENT) {
      throw Error(L4D_ERR_IO, subject +
                                  ": videos and EXR images need the program ffmpeg, which is not "
                                  "there: install ffmpeg");
    }
    fail("cannot start ffmpeg", error);
  }
  stream_ = ours.release();
}

FfmpegProcess::~FfmpegProcess() {
  close_stream();
  if (pid_ < 0) return;
  ::kill(pid_, SIGKILL);
  wait();
}

void FfmpegProcess::close_stream() {
  if (stream_ >= 0) ::close(stream_);
  stream_ = -1;
}

int FfmpegProcess::wait() {
  int status = 0;
  pid_t waited = -1;
  do {
    waited = ::waitpid(pid_, &status, 0);
  } while (waited < 0 && errno == EINTR);
  const bool is_known = waited == pid_;
  pid_ = -1;
  if (!is_known) return -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

std::string FfmpegProcess::words() {
  std::string text(2000, '\0');
  std::rewind(errors_.get());
  text.resize(std::fread(text.data(), 1, text.size(), errors_.get()));
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  return text;
}

void FfmpegProcess::fail(const std::string& what) {
  const std::string text = words();
  throw Error(L4D_ERR_IO, subject_ + ": " + what + (text.empty() ? "" : ": " + text));
}

void FfmpegProcess::fail_with_words(int exit_status) {
  if (!words().empty()) fail("ffmpeg failed");
  fail("ffmpeg failed: " + (exit_status < 0 ? "ended by signal " + std::to_string(-exit_status)
                                            : "exit status " + std::to_string(exit_status)));
}

size_t FfmpegProcess::read(void* dst, size_t n) {
  size_t done = 0;
  while (done < n) {
    const ssize_t got = ::read(stream_, static_cast<char*>(dst) + done, n - done);
    if (got == 0) break;
    if (got < 0) {
      if (errno == EINTR) continue;
      if (errno == ECONNRESET) break;
      throw Error(L4D_ERR_IO, subject_ + ": cannot read from ffmpeg: " + words_of(errno));
    }
    done += static_cast<size_t>(got);
  }
  return done;
}

void FfmpegProcess::write(const void* data, size_t n) {
  size_t done = 0;
  while (done < n) {
    const ssize_t sent =
        ::send(stream_, static_cast<const char*>(data) + done, n - done, MSG_NOSIGNAL);
    if (sent >= 0) {
      done += static_cast<size_t>(sent);
    } else if (errno == EPIPE || errno == ECONNRESET) {
      close_stream();
      fail_with_words(wait());
    } else if (errno != EINTR) {
      throw Error(L4D_ERR_IO, subject_ + ": cannot write to ffmpeg: " + words_of(errno));
    }
  }
}

void FfmpegProcess::finish() {
  close_stream();
  const int status = wait();
  if (status != 0) fail_with_words(status);
}

}  // namespace l4d::io
