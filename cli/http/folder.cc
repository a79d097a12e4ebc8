// SPDX-License-Identifier: Apache-2.0
#include "cli/http/folder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>

#include "cli/text/units.h"

namespace l4d::cli {
namespace {

// A name of one segment or more, each with a first character that is no dot.
bool is_plain(const std::string& name) {
  if (name.empty() || name.find_first_of(std::string("\\\0", 2)) != std::string::npos) return false;
  for (size_t at = 0; at != std::string::npos;) {
    const size_t end = name.find('/', at);
    const std::string segment = name.substr(at, end == std::string::npos ? end : end - at);
    if (segment.empty() || segment[0] == '.') return false;
    at = end == std::string::npos ? end : end + 1;
  }
  return true;
}

bool is_listed(const std::string& name) {
  for (const std::string end : {".l4d", ".m3u8"}) {
    if (name.size() > end.size() && name.compare(name.size() - end.size(), end.size(), end) == 0) {
      return true;
    }
  }
  return false;
}

// File systems count time in steps of the kernel's clock, of up to 10 ms.
constexpr uint64_t kSettled = 50000000;  // ns

uint64_t nanoseconds(const timespec& time) {
  return static_cast<uint64_t>(time.tv_sec) * 1000000000u + static_cast<uint64_t>(time.tv_nsec);
}

FileState state_of(const struct stat& about) {
  timespec now{};
  ::clock_gettime(CLOCK_REALTIME, &now);
  FileState state;
  state.size = static_cast<uint64_t>(about.st_size);
  state.modified = nanoseconds(about.st_mtim);
  const uint64_t at = nanoseconds(now);
  // A time to come is as good as one that has passed: the next change brings it back to now.
  state.is_settled = state.modified + kSettled < at || at + kSettled < state.modified;
  return state;
}

}  // namespace

FileState state_of(int fd) {
  struct stat about;
  return ::fstat(fd, &about) == 0 ? state_of(about) : FileState{};
}

ServedFile::~ServedFile() {
  if (fd >= 0) ::close(fd);
}

// Empty where there is nothing of this name, or where it leads out of the folder.
std::filesystem::path Folder::find(const std::string& name) const {
  if (name.empty()) return path_;
  if (!is_plain(name)) return {};
  std::error_code error;
  const std::filesystem::path path = std::filesystem::canonical(path_ / name, error);
  if (error) return {};
  const auto [rest, unused] = std::mismatch(path_.begin(), path_.end(), path.begin(), path.end());
  (void)unused;
  return rest == path_.end() ? path : std::filesystem::path();
}

bool Folder::has_file(const std::string& name) const {
  std::error_code error;
  const std::filesystem::path path = find(name);
  return !path.empty() && std::filesystem::is_regular_file(path, error);
}

std::string Folder::path_of(const std::string& name) const {
  return has_file(name) ? find(name).string() : std::string();
}

bool Folder::has_folder(const std::string& name) const {
  std::error_code error;
  const std::filesystem::path path = find(name);
  return !path.empty() && std::filesystem::is_directory(path, error);
}

std::shared_ptr<ServedFile> Folder::open(const std::string& name) const {
  // Opening a pipe or a device can change it.
  if (!has_file(name)) return nullptr;
  auto file = std::make_shared<ServedFile>();
  // It may have become a pipe since.
  file->fd = ::open(find(name).c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  struct stat about;
  if (file->fd < 0 || ::fstat(file->fd, &about) != 0 || !S_ISREG(about.st_mode)) return nullptr;
  file->state = state_of(about);
  file->tag = format("\"%llx-%llx-%llx\"", static_cast<unsigned long long>(about.st_ino),
                     static_cast<unsigned long long>(file->state.size),
                     static_cast<unsigned long long>(file->state.modified));
  return file;
}

std::vector<Folder::Entry> Folder::list(const std::string& name) const {
  std::vector<Entry> entries;
  const std::filesystem::path path = find(name);
  if (path.empty()) return entries;
  std::error_code error;
  std::filesystem::directory_iterator at(path, error);
  for (; !error && at != std::filesystem::directory_iterator(); at.increment(error)) {
    const std::string own = at->path().filename().string();
    const std::string below = name.empty() ? own : name + "/" + own;
    if (has_folder(below)) {
      entries.push_back({own, true});
    } else if (is_listed(own) && has_file(below)) {
      entries.push_back({own, false});
    }
  }
  std::sort(entries.begin(), entries.end(),
            [](const Entry& a, const Entry& b) { return a.name < b.name; });
  return entries;
}

bool Folder::may_have_streams() const {
  // A home or a disk takes minutes to walk through.
  constexpr size_t kMostEntries = 10000;
  // Links to folders within it are not followed: what they lead to is met anyway.
  std::error_code error;
  size_t entries = 0;
  std::filesystem::recursive_directory_iterator at(
      path_, std::filesystem::directory_options::skip_permission_denied, error);
  for (; !error && at != std::filesystem::recursive_directory_iterator(); at.increment(error)) {
    if (++entries > kMostEntries) return true;
    const std::string name = at->path().filename().string();
    if (name[0] == '.') {
      at.disable_recursion_pending();
    } else if (is_listed(name) && has_file(at->path().lexically_relative(path_).string())) {
      return true;
    }
  }
  return false;
}

}  // namespace l4d::cli
