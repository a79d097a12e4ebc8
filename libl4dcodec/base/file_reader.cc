// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/base/file_reader.h"

#include <string>

#ifdef _WIN32
#include <algorithm>

#include "libl4dcodec/base/win32.h"
#else
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#endif

namespace l4d {
namespace {

Status cannot_open(const char* path, const std::string& why) {
  return Status(L4D_ERR_IO, "cannot open '" + std::string(path) + "': " + why);
}

}  // namespace

#ifdef _WIN32

void FileReader::close() {
  if (file_ != nullptr) ::CloseHandle(file_);
  file_ = nullptr;
}

Status FileReader::open(const char* path) {
  close();
  const HANDLE file =
      ::CreateFileW(wide(path).c_str(), GENERIC_READ, FILE_SHARE_READ | FILE_SHARE_DELETE, nullptr,
                    OPEN_EXISTING, FILE_ATTRIBUTE_NORMAL, nullptr);
  if (file == INVALID_HANDLE_VALUE) return cannot_open(path, last_error_text());
  file_ = file;
  return {};
}

l4d_reader FileReader::reader() {
  l4d_reader r{};
  r.struct_size = sizeof r;
  r.user = this;
  r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    OVERLAPPED at{};
    at.Offset = static_cast<DWORD>(offset);
    at.OffsetHigh = static_cast<DWORD>(offset >> 32);
    const DWORD most = static_cast<DWORD>(std::min<size_t>(n, size_t{1} << 30));
    DWORD got = 0;
    if (::ReadFile(static_cast<FileReader*>(user)->file_, dst, most, &got, &at)) return got;
    return ::GetLastError() == ERROR_HANDLE_EOF ? 0 : -1;
  };
  r.size = [](void* user) -> int64_t {
    LARGE_INTEGER size;
    const HANDLE file = static_cast<FileReader*>(user)->file_;
    const bool regular = ::GetFileType(file) == FILE_TYPE_DISK;
    return regular && ::GetFileSizeEx(file, &size) ? size.QuadPart : -1;
  };
  return r;
}

#else

void FileReader::close() {
  if (file_ >= 0) ::close(file_);
  file_ = -1;
}

Status FileReader::open(const char* path) {
  close();
  // Without waiting for the writer of a named pipe: that has no size, and is refused then.
  file_ = ::open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  return file_ < 0 ? cannot_open(path, std::strerror(errno)) : Status();
}

l4d_reader FileReader::reader() {
  l4d_reader r{};
  r.struct_size = sizeof r;
  r.user = this;
  r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    const int file = static_cast<FileReader*>(user)->file_;
    ssize_t got;
    do {
      got = ::pread(file, dst, n, static_cast<off_t>(offset));
    } while (got < 0 && errno == EINTR);
    return got;
  };
  r.size = [](void* user) -> int64_t {
    struct stat st {};
    const int file = static_cast<FileReader*>(user)->file_;
    return ::fstat(file, &st) == 0 && S_ISREG(st.st_mode) ? st.st_size : -1;
  };
  return r;
}

#endif

}  // namespace l4d
