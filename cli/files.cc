// SPDX-License-Identifier: Apache-2.0
#include "cli/files.h"

#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

#include "cli/progress.h"

namespace l4d::cli {
namespace fs = std::filesystem;
namespace {

Failure io_failure(const std::string& name, const char* action, int error) {
  return Failure(L4D_ERR_IO, name + ": " + action + ": " + std::strerror(error));
}

// Copies until the end of `from`; false with errno set on failure.
bool copy(std::FILE* from, std::FILE* to) {
  char block[1 << 16];
  size_t got = 0;
  while ((got = std::fread(block, 1, sizeof(block), from)) > 0) {
    if (interrupted()) {
      errno = EINTR;
      return false;
    }
    if (std::fwrite(block, 1, got, to) != got) return false;
  }
  return std::ferror(from) == 0 && std::fflush(to) == 0;
}

// As copy, from what may keep one waiting. A signal that comes right before a read does not end it,
// so that the waiting is done in slices.
bool spool(int from, std::FILE* to) {
  constexpr int kSliceMilliseconds = 100;
  char block[1 << 16];
  for (;;) {
    pollfd waiting = {from, POLLIN, 0};
    const int ready = ::poll(&waiting, 1, kSliceMilliseconds);
    if (interrupted()) {
      errno = EINTR;
      return false;
    }
    if (ready < 0 && errno != EINTR) return false;
    if (ready <= 0) continue;
    const ssize_t got = ::read(from, block, sizeof(block));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return false;
    if (got == 0) return std::fflush(to) == 0;
    if (std::fwrite(block, 1, static_cast<size_t>(got), to) != static_cast<size_t>(got)) {
      return false;
    }
  }
}

}  // namespace

Input::Input(const std::string& name) : name_(name == "-" ? "stdin" : name), path_(name) {
  if (name == "-") {
    if (::isatty(STDIN_FILENO) == 1) throw usage_error("input '-' is a terminal");
    spool_.reset(std::tmpfile());
    if (!spool_) throw io_failure(name_, "cannot create a temporary file", errno);
    if (!spool(STDIN_FILENO, spool_.get())) throw io_failure(name_, "cannot copy", errno);
    std::rewind(spool_.get());
    path_ = "/dev/fd/" + std::to_string(::fileno(spool_.get()));
  }
  std::error_code error;
  if (fs::is_directory(path_, error)) throw io_failure(name_, "cannot read", EISDIR);
  const io::FileHandle file(std::fopen(path_.c_str(), "rb"));
  if (!file) throw io_failure(name_, "cannot open", errno);
  struct stat status {};
  if (::fstat(::fileno(file.get()), &status) != 0 || !S_ISREG(status.st_mode)) {
    throw Failure(L4D_ERR_IO, name_ + ": is no regular file; pipe it in and name it '-'");
  }
  bytes_ = static_cast<uint64_t>(status.st_size);
  char magic[4] = {};
  const size_t got = std::fread(magic, 1, sizeof(magic), file.get());
  is_ply_ = got == sizeof(magic) && std::memcmp(magic, "ply", 3) == 0 &&
            (magic[3] == '\n' || magic[3] == '\r');
}

Output::Output(const Context& context, const std::string& name,
               const std::vector<const Input*>& inputs)
    : name_(name), path_(name) {
  if (name == "-") {
    if (context.options.json) throw usage_error("--json and output '-' both want stdout");
    if (::isatty(STDOUT_FILENO) == 1) throw usage_error("binary output to a terminal refused");
    path_ = (fs::temp_directory_path() / "l4dcodec-XXXXXX").string();
    const int fd = ::mkstemp(path_.data());
    if (fd < 0) throw io_failure(path_, "cannot create a temporary file", errno);
    ::close(fd);
    return;
  }
  std::error_code error;
  const fs::file_status status = fs::status(name, error);
  if (!fs::exists(status)) {
    const fs::path folder = fs::path(name).parent_path();
    if (!folder.empty() && !fs::is_directory(folder, error)) {
      throw io_failure(name, "cannot create", ENOENT);
    }
    return;
  }
  if (fs::is_directory(status)) throw io_failure(name, "cannot write", EISDIR);
  is_special_ = !fs::is_regular_file(status);
  for (const Input* input : inputs) {
    if (fs::equivalent(input->path(), name, error)) {
      throw usage_error(name + ": is the input too");
    }
  }
  if (!is_special_ && !context.options.force) {
    throw Failure(L4D_ERR_IO, name + ": exists already; --force overwrites it");
  }
}

Output::~Output() {
  if (is_stdout()) ::unlink(path_.c_str());
}

uint64_t Output::finish() {
  std::error_code error;
  const uintmax_t bytes = fs::file_size(path_, error);
  if (is_stdout()) {
    const io::FileHandle file(std::fopen(path_.c_str(), "rb"));
    if (!file || !copy(file.get(), stdout)) throw io_failure("stdout", "cannot write", errno);
  }
  return error ? 0 : static_cast<uint64_t>(bytes);
}

std::string derived_name(const std::string& input, const std::string& extension) {
  if (input == "-") throw usage_error("input '-' needs --output");
  return fs::path(input).replace_extension(extension).string();
}

FileReader::FileReader(const std::string& path) : file_(std::fopen(path.c_str(), "rb")) {
  if (!file_) throw io_failure(path, "cannot open", errno);
  reader_.struct_size = sizeof(reader_);
  reader_.user = file_.get();
  reader_.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    if (interrupted()) return -1;
    size_t done = 0;
    while (done < n) {
      const ssize_t got =
          ::pread(::fileno(static_cast<std::FILE*>(user)), static_cast<char*>(dst) + done, n - done,
                  static_cast<off_t>(offset + done));
      if (got < 0) return -1;
      if (got == 0) break;
      done += static_cast<size_t>(got);
    }
    return static_cast<int64_t>(done);
  };
  reader_.size = [](void* user) -> int64_t {
    struct stat status {};
    return ::fstat(::fileno(static_cast<std::FILE*>(user)), &status) == 0 ? status.st_size : -1;
  };
}

}  // namespace l4d::cli
