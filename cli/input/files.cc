// SPDX-License-Identifier: Apache-2.0
#include "cli/input/files.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

#include "cli/command/progress.h"
#include "cli/input/sequence.h"
#include "io/file/output_name.h"
#include "io/formats/scene_file.h"

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

bool names_stdout(const std::string& name) {
  return name == "-" || descriptor_named(name) == STDOUT_FILENO;
}

}  // namespace

std::string scene_help(const std::string& what) {
  return what + ": .l4d, " + io::list_of_scene_files() + " (docs/formats.md), '-' = stdin";
}

uint64_t require_file(const std::string& path, const std::string& name) {
  // Before it is opened: opening a named pipe waits for its writer.
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) throw io_failure(name, "cannot open", errno);
  if (S_ISDIR(status.st_mode)) {
    throw Failure(L4D_ERR_IO, name +
                                  ": is a folder; `encode` and `convert` make a stream of a "
                                  "folder of frames");
  }
  if (!S_ISREG(status.st_mode)) {
    throw Failure(L4D_ERR_IO, name + ": is no regular file; pipe it in and name it '-'");
  }
  const io::FileHandle file(std::fopen(path.c_str(), "rb"));
  if (!file) throw io_failure(name, "cannot open", errno);
  return static_cast<uint64_t>(status.st_size);
}

Input::Input(Context& context, const std::string& name, const std::string& what, bool may_be_empty)
    : name_(name == "-" ? "stdin" : name), path_(name) {
  context.files.add_input(name, what);
  if (name == "-") {
    if (::isatty(STDIN_FILENO) == 1) throw usage_error("input '-' is a terminal");
    spool_ = io::anonymous_file();
    if (!spool(STDIN_FILENO, spool_.get())) throw io_failure(name_, "cannot copy", errno);
    std::rewind(spool_.get());
    path_ = io::path_of(spool_);
  }
  bytes_ = require_file(path_, name_);
  if (bytes_ == 0 && !may_be_empty) {
    throw Failure(L4D_ERR_CORRUPT, name_ + ": the file is empty");
  }
  is_scene_ = io::is_scene_file(path_, name);
  const std::string refusal = io::foreign_refusal(path_, name);
  if (!refusal.empty()) throw Failure(L4D_ERR_FEATURE_UNSUPPORTED, name_ + refusal);
}

Output::Output(Context& context, const std::string& name, const std::string& what, bool is_text)
    : path_(name), is_stdout_(names_stdout(name)) {
  if (is_stdout_) {
    if (context.options.json) throw usage_error("--json and output '-' both want stdout");
    if (!is_text && ::isatty(STDOUT_FILENO) == 1) {
      throw usage_error("binary output to a terminal refused");
    }
    spool_ = io::anonymous_file();
    path_ = io::path_of(spool_);
    return;
  }
  std::string place = name;
  const FileError unresolved = follow_links(&place);
  if (!unresolved.ok()) throw io_failure(name, unresolved.action, unresolved.error);
  std::error_code error;
  const fs::file_status status = fs::status(place, error);
  is_special_ = descriptor_named(place) >= 0 ||
                (fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status));
  if (fs::is_directory(status)) throw io_failure(name, "cannot write", EISDIR);
  // A name that is too long, a folder that must not be entered.
  if (!fs::status_known(status)) throw io_failure(name, "cannot write", error.value());
  context.files.add_output(name, what);
  if (is_special_) return;
  // A link that leads nowhere is in the way too: what comes to lie where it leads to is not where
  // the name is.
  if (fs::exists(fs::symlink_status(name, error)) && !context.options.force) {
    throw Failure(L4D_ERR_IO, name + ": exists already; --force overwrites it");
  }
  // What would fail at the end of the work fails before it.
  const fs::path parent = fs::path(place).parent_path();
  const std::string folder = parent.empty() ? "." : parent.string();
  if (!fs::is_directory(folder, error)) {
    throw Failure(L4D_ERR_IO, name + ": cannot create: there is no folder '" + folder + "'");
  }
  const bool writable =
      ::faccessat(AT_FDCWD, folder.c_str(), W_OK | X_OK, AT_EACCESS) == 0 &&
      (!fs::exists(status) || ::faccessat(AT_FDCWD, place.c_str(), W_OK, AT_EACCESS) == 0);
  if (!writable) throw io_failure(name, "cannot write", errno);
}

uint64_t Output::finish() {
  std::error_code error;
  const uintmax_t bytes = fs::file_size(path_, error);
  if (spool_) {
    std::rewind(spool_.get());
    if (!copy(spool_.get(), stdout)) throw io_failure("stdout", "cannot write", errno);
  }
  return error ? 0 : static_cast<uint64_t>(bytes);
}

void check_extension(const std::string& name, const char* option,
                     const std::vector<std::string>& written, bool strict) {
  const std::string odds = io::name_at_odds(name, written, strict);
  if (!odds.empty()) throw usage_error(std::string(option) + ": " + odds);
}

void check_one_file(const std::string& name, const char* option,
                    const std::vector<std::string>& written) {
  if (NumberedName::parse(name)) {
    throw usage_error(
        std::string(option) + ": '" + name +
        "' names a sequence, and this is one file; `slice` and `convert` write a file "
        "for each frame");
  }
  check_extension(name, option, written);
}

std::string output_name(const std::string& given, const std::string& input,
                        const std::string& extension) {
  if (!given.empty()) {
    check_one_file(given, "--output", {fs::path("x" + extension).extension().string()});
    return given;
  }
  if (input == "-") throw usage_error("input '-' needs --output");
  return fs::path(input).replace_extension(extension).string();
}

FileReader::FileReader(const std::string& path) : file_(std::fopen(path.c_str(), "rb")) {
  if (!file_) throw io_failure(path, "cannot open", errno);
  reader_ = L4D_INIT(l4d_reader);
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
