// SPDX-License-Identifier: Apache-2.0
// The writer of files on Windows. A temporary file cannot be opened by others while it is written,
// which is its lock; links are replaced, not followed; permissions are those of the folder.
#include <fcntl.h>
#include <io.h>

#include <cerrno>
#include <cstdio>
#include <string_view>
#include <vector>

#include "libl4dcodec/base/atomic_file.h"
#include "libl4dcodec/base/win32.h"

namespace l4d {
namespace {

constexpr std::string_view kMark = ".l4dtmp";
constexpr std::string_view kWriters = "0123456789abcdef";

int error_number() {
  switch (::GetLastError()) {
    case ERROR_FILE_NOT_FOUND:
    case ERROR_PATH_NOT_FOUND:
    case ERROR_INVALID_NAME:
      return ENOENT;
    case ERROR_ACCESS_DENIED:
    case ERROR_SHARING_VIOLATION:
      return EACCES;
    case ERROR_FILE_EXISTS:
    case ERROR_ALREADY_EXISTS:
      return EEXIST;
    case ERROR_DISK_FULL:
    case ERROR_HANDLE_DISK_FULL:
      return ENOSPC;
    default:
      return EIO;
  }
}

HANDLE handle_of(int descriptor) { return reinterpret_cast<HANDLE>(::_get_osfhandle(descriptor)); }

// A descriptor of a file that was not there, and that nobody else can open or delete; -1 where it
// cannot be made.
int create_alone(const std::string& name) {
  const HANDLE file = ::CreateFileW(wide(name).c_str(), GENERIC_WRITE | DELETE, 0, nullptr,
                                    CREATE_NEW, FILE_ATTRIBUTE_NORMAL, nullptr);
  if (file == INVALID_HANDLE_VALUE) return -1;
  return ::_open_osfhandle(reinterpret_cast<intptr_t>(file), _O_BINARY | _O_WRONLY);
}

// Gives the open file the name `target`, in the place of what has it.
bool rename_open(HANDLE file, const std::string& target) {
  const std::wstring name = wide(target);
  const size_t bytes = name.size() * sizeof(wchar_t);
  std::vector<unsigned char> storage(sizeof(FILE_RENAME_INFO) + bytes);
  auto* info = reinterpret_cast<FILE_RENAME_INFO*>(storage.data());
  info->ReplaceIfExists = TRUE;
  info->FileNameLength = static_cast<DWORD>(bytes);
  name.copy(info->FileName, name.size());
  return ::SetFileInformationByHandle(file, FileRenameInfo, info,
                                      static_cast<DWORD>(storage.size())) != 0;
}

}  // namespace

int descriptor_named(const std::string&) { return -1; }
FileError follow_links(std::string*) { return {}; }

std::string target_of_temporary(const std::string& path) {
  const size_t mark = path.rfind(kMark);
  const bool is_one = mark != std::string::npos && path.size() == mark + kMark.size() + 1 &&
                      kWriters.find(path.back()) != std::string_view::npos;
  return is_one ? path.substr(0, mark) : std::string();
}

FileError AtomicFile::open(const char* path) {
  discard();
  target_ = path;
  if (target_.empty()) return {"cannot open", ENOENT};
  const DWORD attributes = ::GetFileAttributesW(wide(target_).c_str());
  if (attributes != INVALID_FILE_ATTRIBUTES && (attributes & FILE_ATTRIBUTE_DIRECTORY) != 0) {
    return {"cannot write", EISDIR};
  }
  if (attributes != INVALID_FILE_ATTRIBUTES && (attributes & FILE_ATTRIBUTE_READONLY) != 0) {
    return {"cannot write", EACCES};
  }
  return create_temporary();
}

FileError AtomicFile::create_temporary() {
  for (const char writer : kWriters) {
    std::string name = target_;
    name.append(kMark).push_back(writer);
    // Of a writer that is dead; a living one keeps it open.
    ::DeleteFileW(wide(name).c_str());
    if (is_open()) continue;
    fd_ = create_alone(name);
    const int error = is_open() ? 0 : error_number();
    if (is_open()) temporary_ = std::move(name);
    if (!is_open() && error != EEXIST && error != EACCES) {
      return {"cannot create a temporary file beside", error};
    }
  }
  return is_open() ? FileError{} : FileError{"cannot create a temporary file beside", EACCES};
}

FileError AtomicFile::write(const void* data, size_t n) {
  const char* from = static_cast<const char*>(data);
  while (n > 0) {
    const unsigned most = n < (1u << 30) ? static_cast<unsigned>(n) : 1u << 30;
    const int done = ::_write(fd_, from, most);
    if (done <= 0) return {"cannot write", done < 0 ? errno : EIO};
    from += done;
    n -= static_cast<size_t>(done);
  }
  return {};
}

FileError AtomicFile::commit() {
  if (!::FlushFileBuffers(handle_of(fd_))) return {"cannot write", error_number()};
  if (!rename_open(handle_of(fd_), target_)) {
    return {"cannot rename the finished file to", error_number()};
  }
  temporary_.clear();
  const int fd = fd_;
  fd_ = -1;
  return ::_close(fd) == 0 ? FileError{} : FileError{"cannot finish writing", errno};
}

void AtomicFile::discard() {
  if (fd_ >= 0) ::_close(fd_);
  fd_ = -1;
  if (!temporary_.empty()) ::DeleteFileW(wide(temporary_).c_str());
  temporary_.clear();
}

}  // namespace l4d
