// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/base/atomic_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstdio>
#include <string_view>

namespace l4d {
namespace {

constexpr mode_t kPermissions = 0777;
constexpr mode_t kPrivate = 0600;
// A temporary file is NAME.l4dtmpK: so many may write one file at the same time.
constexpr std::string_view kMark = ".l4dtmp";
constexpr std::string_view kWriters = "0123456789abcdef";
// Of a file that grows, of which there is one writer at a time.
constexpr char kGrowing = 'g';
constexpr size_t kMaxName = 240;  // bytes of NAME, so that the whole fits into 255
constexpr int kMaxLinks = 40;
constexpr int kMaxAttempts = 100;

bool same_file(const struct stat& a, const struct stat& b) {
  return a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

std::string temporary_prefix(const std::string& target) {
  const size_t slash = target.rfind('/');
  const size_t begin = slash == std::string::npos ? 0 : slash + 1;
  size_t size = target.size() - begin;
  if (size > kMaxName) {
    size = kMaxName;
    // Not within a character of UTF-8.
    while (size > 0 && (static_cast<unsigned char>(target[begin + size]) & 0xc0) == 0x80) --size;
  }
  return target.substr(0, begin + size).append(kMark);
}

// Removes the temporary file of a writer that is dead: one of this user that nobody has locked.
// Returns whether nothing has the name any more.
bool remove_stale(const char* name) {
  const int fd = ::open(name, O_WRONLY | O_NONBLOCK | O_NOFOLLOW | O_NOCTTY | O_CLOEXEC);
  if (fd < 0) return errno == ENOENT;
  struct stat opened {
  }, named{};
  // Its writer may have finished between the opening and the locking: the file then has its final
  // name, and must stay.
  const bool stale = ::fstat(fd, &opened) == 0 && S_ISREG(opened.st_mode) &&
                     opened.st_uid == ::geteuid() && ::flock(fd, LOCK_EX | LOCK_NB) == 0 &&
                     ::lstat(name, &named) == 0 && same_file(opened, named);
  const bool removed = stale && ::unlink(name) == 0;
  ::close(fd);
  return removed;
}

// Whether a writer holds the file.
bool is_locked(const char* name) {
  const int fd = ::open(name, O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
  if (fd < 0) return false;
  const bool locked = ::flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  ::close(fd);
  return locked;
}

// Creates and locks a file that was not there. Returns its descriptor, or -1 with errno: EEXIST
// where another writer has the name.
int create_locked(const char* name, struct stat* status) {
  for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
    const int fd = ::open(name, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd < 0 && errno != EEXIST) return -1;
    if (fd < 0) {
      if (remove_stale(name)) continue;
      break;
    }
    // Before it is locked it looks stale to others. A file system without locks never removes.
    const bool taken = ::flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    if (!taken && ::fstat(fd, status) == 0 && status->st_nlink > 0) return fd;
    ::close(fd);
  }
  errno = EEXIST;
  return -1;
}

}  // namespace

int descriptor_named(const std::string& path) {
  if (path == "/dev/stdin") return STDIN_FILENO;
  if (path == "/dev/stdout") return STDOUT_FILENO;
  if (path == "/dev/stderr") return STDERR_FILENO;
  for (const std::string_view folder : {"/dev/fd/", "/proc/self/fd/"}) {
    if (path.compare(0, folder.size(), folder) != 0) continue;
    const size_t digits = path.size() - folder.size();
    if (digits == 0 || digits > 8) return -1;
    int number = 0;
    for (size_t i = folder.size(); i < path.size(); ++i) {
      if (path[i] < '0' || path[i] > '9') return -1;
      number = 10 * number + (path[i] - '0');
    }
    return number;
  }
  return -1;
}

std::string target_of_temporary(const std::string& path) {
  const size_t mark = path.rfind(kMark);
  const bool is_one =
      mark != std::string::npos && path.size() == mark + kMark.size() + 1 &&
      (path.back() == kGrowing || kWriters.find(path.back()) != std::string_view::npos);
  return is_one ? path.substr(0, mark) : std::string();
}

FileError follow_links(std::string* path) {
  for (int link = 0; link < kMaxLinks; ++link) {
    if (descriptor_named(*path) >= 0) return {};
    char target[PATH_MAX];
    const ssize_t size = ::readlink(path->c_str(), target, sizeof(target));
    if (size < 0) return {};  // no link; what else is wrong shows when it is opened
    if (size == static_cast<ssize_t>(sizeof(target))) return {"cannot follow", ENAMETOOLONG};
    const size_t slash = target[0] == '/' ? std::string::npos : path->rfind('/');
    path->erase(slash == std::string::npos ? 0 : slash + 1);
    path->append(target, static_cast<size_t>(size));
  }
  return {"cannot follow", ELOOP};
}

FileError AtomicFile::open(const char* path) { return open(path, false); }

FileError AtomicFile::open_growing(const char* path) { return open(path, true); }

FileError AtomicFile::open(const char* path, bool grows) {
  discard();
  target_ = path;
  if (target_.empty()) return {"cannot open", ENOENT};
  const FileError error = follow_links(&target_);
  if (!error.ok()) return error;
  const int descriptor = descriptor_named(target_);
  if (descriptor >= 0) {
    // Not opened anew: writing goes on at the position of the descriptor.
    fd_ = ::fcntl(descriptor, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
    return fd_ < 0 ? FileError{"cannot open", errno} : FileError{};
  }
  struct stat old {};
  const bool exists = ::stat(target_.c_str(), &old) == 0;
  if (!exists && errno != ENOENT) return {"cannot open", errno};
  if (exists && S_ISDIR(old.st_mode)) return {"cannot write", EISDIR};
  if (exists && !S_ISREG(old.st_mode)) {
    fd_ = ::open(target_.c_str(), O_WRONLY | O_CLOEXEC | O_NOCTTY);
    return fd_ < 0 ? FileError{"cannot open", errno} : FileError{};
  }
  // Renaming asks for the rights on the folder only.
  if (exists && ::faccessat(AT_FDCWD, target_.c_str(), W_OK, AT_EACCESS) != 0) {
    return {"cannot write", errno};
  }
  const FileError failed = create_temporary(grows);
  if (!failed.ok()) return failed;
  // With the temporary file at hand: a writer whose file has its name already holds none.
  if (grows && is_locked(target_.c_str())) {
    discard();
    return {"cannot write", EBUSY};
  }
  if (!exists) return {};
  mode_ = old.st_mode & kPermissions;
  struct stat fresh {};
  if (::fstat(fd_, &fresh) != 0) return {"cannot create", errno};
  if (fresh.st_uid != old.st_uid || fresh.st_gid != old.st_gid) {
    // Who may not give files away keeps what others may do to what the others could do before.
    const bool same_group = ::fchown(fd_, old.st_uid, old.st_gid) == 0 ||
                            ::fchown(fd_, static_cast<uid_t>(-1), old.st_gid) == 0;
    if (!same_group) mode_ &= ~unsigned{S_IRWXG};
  }
  return {};
}

FileError AtomicFile::create_temporary(bool grows) {
  const std::string prefix = temporary_prefix(target_);
  std::string writers(kWriters);
  writers.insert(grows ? writers.begin() : writers.end(), kGrowing);
  for (const char writer : writers) {
    std::string name = prefix + writer;
    const bool others = writer == kGrowing && !grows;
    if (is_open() || others) {
      remove_stale(name.c_str());
      continue;
    }
    struct stat status {};
    fd_ = create_locked(name.c_str(), &status);
    if (!is_open() && errno != EEXIST) return {"cannot create a temporary file beside", errno};
    if (!is_open() && grows) return {"cannot write", EBUSY};
    if (!is_open()) continue;
    temporary_ = std::move(name);
    mode_ = status.st_mode & kPermissions;
    ::fchmod(fd_, kPrivate);
  }
  return is_open() ? FileError{} : FileError{"cannot create a temporary file beside", EEXIST};
}

FileError AtomicFile::write(const void* data, size_t n) {
  const char* from = static_cast<const char*>(data);
  while (n > 0) {
    const ssize_t done = ::write(fd_, from, n);
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return {"cannot write", done < 0 ? errno : EIO};
    from += done;
    n -= static_cast<size_t>(done);
  }
  return {};
}

FileError AtomicFile::publish() {
  if (!temporary_.empty()) {
    ::fchmod(fd_, mode_);
    int synced;
    do {
      synced = ::fsync(fd_);
    } while (synced != 0 && errno == EINTR);
    // Some file systems have no such call.
    if (synced != 0 && errno != EINVAL && errno != ENOTSUP && errno != ENOSYS) {
      return {"cannot write", errno};
    }
    // Renamed while it is locked: unlocked it would be taken for stale.
    if (std::rename(temporary_.c_str(), target_.c_str()) != 0) {
      return {"cannot rename the finished file to", errno};
    }
    temporary_.clear();
  }
  return {};
}

FileError AtomicFile::commit() {
  const FileError failed = publish();
  if (!failed.ok()) return failed;
  const int fd = fd_;
  fd_ = -1;
  return ::close(fd) == 0 ? FileError{} : FileError{"cannot finish writing", errno};
}

FileError AtomicFile::truncate(uint64_t bytes) {
  const auto end = static_cast<off_t>(bytes);
  const bool done = ::ftruncate(fd_, end) == 0 && ::lseek(fd_, end, SEEK_SET) == end;
  return done ? FileError{} : FileError{"cannot shorten", errno};
}

bool AtomicFile::is_in_place() const {
  struct stat ours {
  }, named{};
  return ::fstat(fd_, &ours) == 0 && ::stat(target_.c_str(), &named) == 0 && same_file(ours, named);
}

void AtomicFile::discard() {
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
  temporary_.clear();
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

}  // namespace l4d
