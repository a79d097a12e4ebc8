// SPDX-License-Identifier: Apache-2.0
// The one writer of files, of the library and of its tools. It knows nothing but the standard
// library, so that the layers beside the codec may include it too.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace l4d {

// Why a call failed: what it tried, as "cannot open", and errno. ok() where it did not fail.
struct FileError {
  const char* action = nullptr;
  int error = 0;
  bool ok() const { return action == nullptr; }
};

// An output that takes its name only when it is whole, and leaves nothing behind otherwise.
//
// It is written to a temporary file beside its place, which nobody else can read until it is whole.
// commit() gives it the permissions of the file that it replaces (else those that the umask
// leaves), makes sure that it lies on the disk, and renames it. Where a symbolic link has the name,
// what the link leads to is written, whether that exists or not.
//
// A process that is killed leaves its temporary file. The next writer of a file of that name
// removes it: a writer holds a lock on its temporary file, and the lock dies with the process.
//
// What is no regular file (a device, a pipe) and what is open already (/dev/stdout, /dev/fd/3) is
// written in place. Windows has neither: a link is replaced there, and permissions are the
// folder's.
class AtomicFile {
 public:
  AtomicFile() = default;
  ~AtomicFile() { discard(); }
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  // Fails where the path is a folder, or a file that the user must not write.
  FileError open(const char* path);
  FileError write(const void* data, size_t n);
  FileError commit();
  // Gives up: closes, and removes the temporary file.
  void discard();

#ifndef _WIN32
  // As open, for a file that is written on after it has its name. Fails with EBUSY while another
  // process writes that file in this way. Others read what is written, so a write is what they may
  // see.
  FileError open_growing(const char* path);
  // As commit, but the file stays open, and locked, until discard(), which leaves it there.
  FileError publish();
  // Of a file that grows: takes back what lies behind its first `bytes` bytes.
  FileError truncate(uint64_t bytes);
  // Whether the file that was published still has its name.
  bool is_in_place() const;
  int descriptor() const { return fd_; }
#endif

  bool is_open() const { return fd_ >= 0; }
  // For another program to write to; "" where the file is written in place.
  const std::string& temporary_path() const { return temporary_; }

 private:
#ifdef _WIN32
  FileError create_temporary();
#else
  FileError open(const char* path, bool grows);
  FileError create_temporary(bool grows);
#endif

  std::string target_;     // symbolic links resolved
  std::string temporary_;  // "": written in place
  unsigned mode_ = 0;      // permissions that the finished file gets
  int fd_ = -1;
};

// `path` with symbolic links in its last part followed, to a place that need not exist. Paths of
// open descriptors stay as they are.
FileError follow_links(std::string* path);
// N where the path is /dev/fd/N or another name of an open descriptor, else -1.
int descriptor_named(const std::string& path);
// The place for which a temporary file of that name would be, "" where it is none.
std::string target_of_temporary(const std::string& path);

}  // namespace l4d
