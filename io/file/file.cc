// SPDX-License-Identifier: Apache-2.0
#include "io/file/file.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

namespace l4d::io {
namespace fs = std::filesystem;
namespace {

[[noreturn]] void fail(const std::string& path, const char* action, int error) {
  throw Error(L4D_ERR_IO, path + ": " + action + ": " + std::generic_category().message(error));
}

void check(const FileError& error, const std::string& path) {
  if (!error.ok()) fail(path, error.action, error.error);
}

constexpr uint64_t kMaxPipeBytes = uint64_t{4} << 30;
constexpr int kMaxIdleMilliseconds = 3000;

}  // namespace

InputFile::InputFile(const std::string& path, const Hold& holder) : path_(path) {
  // Opening a named pipe would wait for its writer, for ever if there is none.
  const int fd = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC | O_NOCTTY);
  if (fd < 0) fail(path, "cannot open", errno);
  file_.reset(::fdopen(fd, "rb"));
  if (!file_) {
    ::close(fd);
    fail(path, "cannot open", ENOMEM);
  }
  struct stat status {};
  if (::fstat(fd, &status) != 0) fail(path, "cannot read the size", errno);
  if (S_ISREG(status.st_mode)) {
    size_ = static_cast<uint64_t>(status.st_size);
    return;
  }
  if (S_ISDIR(status.st_mode)) fail(path, "cannot read", EISDIR);
  if (!S_ISFIFO(status.st_mode) && !S_ISSOCK(status.st_mode)) {
    throw Error(L4D_ERR_IO, path + ": is a device and no file");
  }
  slurp(fd, holder);
  file_.reset();
  size_ = slurped_.size();
}

void InputFile::slurp(int fd, const Hold& holder) {
  constexpr int kSliceMilliseconds = 100;
  int idle = 0;  // slices in which nobody had the pipe open for writing
  uint8_t block[1 << 16];
  for (;;) {
    pollfd waiting = {fd, POLLIN, 0};
    const int ready = ::poll(&waiting, 1, kSliceMilliseconds);
    if (ready < 0) fail(path_, "cannot read", errno);
    const ssize_t got = ::read(fd, block, sizeof(block));
    if (got < 0 && errno != EAGAIN) fail(path_, "cannot read", errno);
    if (got > 0) {
      const uint64_t needed = slurped_.size() + static_cast<uint64_t>(got);
      if (needed > slurped_.capacity()) {
        // With the old copy, while the bytes move.
        const uint64_t capacity = std::max<uint64_t>(2 * slurped_.capacity(), needed);
        std::shared_ptr<void> grown = hold(holder, capacity, path_);
        slurped_.reserve(capacity);
        memory_ = std::move(grown);
      }
      slurped_.insert(slurped_.end(), block, block + got);
      if (slurped_.size() > kMaxPipeBytes) {
        throw Error(L4D_ERR_IO, path_ + ": the pipe has more than 4 GiB; write them to a file");
      }
    }
    // A writer that is gone wakes poll; one that has not come yet does not.
    if (got == 0 && ready > 0) return;
    idle = got == 0 ? idle + 1 : 0;
    if (idle * kSliceMilliseconds >= kMaxIdleMilliseconds) {
      throw Error(L4D_ERR_IO, path_ + ": is a pipe that nobody writes to");
    }
  }
}

void InputFile::seek(uint64_t offset) {
  offset_ = std::min(offset, size_);
  if (file_ && ::fseeko(file_.get(), static_cast<off_t>(offset_), SEEK_SET) != 0) {
    fail(path_, "cannot seek", errno);
  }
}

size_t InputFile::read(void* dst, size_t n) {
  // Never past size_, even where the file grows meanwhile: callers count on it.
  size_t got = static_cast<size_t>(std::min<uint64_t>(n, size_ - offset_));
  if (file_) {
    errno = 0;
    got = std::fread(dst, 1, got, file_.get());
    if (std::ferror(file_.get()) != 0) fail(path_, "cannot read", errno);
  } else if (got > 0) {
    std::memcpy(dst, slurped_.data() + offset_, got);
  }
  offset_ += got;
  return got;
}

std::vector<uint8_t> read_whole_file(const std::string& path) {
  InputFile file(path);
  std::vector<uint8_t> bytes(static_cast<size_t>(file.size()));
  bytes.resize(file.read(bytes.data(), bytes.size()));
  return bytes;
}

GrowingFile::GrowingFile(const std::string& path) : path_(path) {
  const FileError failed = file_.open_growing(path.c_str());
  if (failed.error == EBUSY) {
    throw Error(L4D_ERR_IO, path + ": another process is writing this file");
  }
  check(failed, path);
}

void GrowingFile::append(const void* data, size_t n) {
  if (size_ > 0 && !file_.is_in_place()) {
    throw Error(L4D_ERR_IO, path_ + ": was moved, removed or replaced while it was written");
  }
  FileError failed = file_.write(data, n);
  if (failed.ok() && size_ > 0 && ::fsync(file_.descriptor()) != 0) {
    failed = {"cannot write", errno};
  }
  if (failed.ok() && size_ == 0) failed = file_.publish();
  // Half of a member helps nobody, and who appends to it later would make the file unreadable.
  if (!failed.ok()) file_.truncate(size_);
  check(failed, path_);
  size_ += n;
}

OutputFile::OutputFile(const std::string& path, Check check)
    : path_(path), check_(std::move(check)) {
  io::check(file_.open(path.c_str()), path);
}

void OutputFile::write(const void* data, size_t n) {
  constexpr size_t kBlock = size_t{4} << 20;
  const auto* bytes = static_cast<const uint8_t*>(data);
  for (size_t at = 0; at < n; at += kBlock) {
    call(check_);
    check(file_.write(bytes + at, std::min(kBlock, n - at)), path_);
  }
}

void OutputFile::commit() { check(file_.commit(), path_); }

std::optional<FileId> identify(const std::string& path) {
  std::string place = path;
  if (!follow_links(&place).ok()) return std::nullopt;
  const int descriptor = descriptor_named(place);
  struct stat status {};
  const int found = descriptor >= 0 ? ::fstat(descriptor, &status) : ::stat(place.c_str(), &status);
  if (found == 0) {
    if (!S_ISREG(status.st_mode) && !S_ISFIFO(status.st_mode)) return std::nullopt;
    return FileId{status.st_dev, status.st_ino, ""};
  }
  const size_t slash = place.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : place.substr(0, slash + 1);
  if (::stat(folder.c_str(), &status) != 0) return std::nullopt;
  return FileId{status.st_dev, status.st_ino, place.substr(slash + 1)};
}

FileHandle anonymous_file() {
  std::error_code error;
  const fs::path folder = fs::temp_directory_path(error);
  const std::string name = "l4dcodec-XXXXXX";
  std::string path = ((error ? fs::path("/tmp") : folder) / name).string();
  const int fd = ::mkostemp(path.data(), O_CLOEXEC);
  if (fd < 0) fail(path, "cannot create a temporary file", errno);
  ::unlink(path.c_str());
  FileHandle file(::fdopen(fd, "w+b"));
  if (file) return file;
  ::close(fd);
  fail(path, "cannot create a temporary file", ENOMEM);
}

std::string path_of(const FileHandle& file) {
  return "/dev/fd/" + std::to_string(::fileno(file.get()));
}

}  // namespace l4d::io
