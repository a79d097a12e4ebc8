// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "io/file/memory.h"
#include "io/scene/scene.h"
#include "libl4dcodec/base/atomic_file.h"

namespace l4d::io {

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using FileHandle = std::unique_ptr<std::FILE, FileCloser>;

// Sequential input of known length. A pipe has none, so it is read to its end first: a parser
// can then always check a count against the bytes that are left before allocating for it. A named
// pipe that nobody opens for writing within some seconds is refused, and so are devices.
class InputFile {
 public:
  // holder: counts what a pipe makes it keep.
  explicit InputFile(const std::string& path, const Hold& holder = {});
  // Bytes in memory; `name` stands for the path in messages.
  InputFile(const std::string& name, std::vector<uint8_t> bytes)
      : path_(name), slurped_(std::move(bytes)), size_(slurped_.size()) {}

  // Returns fewer than `n` bytes only at the end.
  size_t read(void* dst, size_t n);
  // What read() returns next; at most the size.
  void seek(uint64_t offset);
  uint64_t size() const { return size_; }
  const std::string& path() const { return path_; }

 private:
  void slurp(int fd, const Hold& holder);

  std::string path_;
  FileHandle file_;
  std::vector<uint8_t> slurped_;  // contents, where file_ is not the source
  std::shared_ptr<void> memory_;  // counts them
  uint64_t size_ = 0;
  uint64_t offset_ = 0;
};

std::vector<uint8_t> read_whole_file(const std::string& path);

// Output that appears under its name only when it is complete; see AtomicFile. Throws Error where a
// call fails.
class OutputFile {
 public:
  // check: called before each block of some megabytes; what it throws ends the file.
  explicit OutputFile(const std::string& path, Check check = {});

  void write(const void* data, size_t n);
  void commit();

 private:
  std::string path_;  // as the caller named it, for messages
  AtomicFile file_;
  Check check_;
};

// A file that is appended to under its name, for programs that read it meanwhile. It appears with
// the first bytes, in the place of a file that was there. Throws Error where a call fails.
class GrowingFile {
 public:
  // Fails where another process writes the file in this way.
  explicit GrowingFile(const std::string& path);

  // Returns when the bytes are on the disk: all that comes later comes behind them. If it fails,
  // the file is as it was before. Fails where something else has taken the name of the file.
  void append(const void* data, size_t n);

  uint64_t size() const { return size_; }
  // To read what was appended.
  int descriptor() const { return file_.descriptor(); }

 private:
  std::string path_;
  AtomicFile file_;
  uint64_t size_ = 0;
};

// Which file a path leads to, to find out whether two paths lead to one: its device and inode,
// or of what does not exist yet those of the folder, and the name in it.
struct FileId {
  uint64_t device = 0, inode = 0;
  std::string name;
  bool operator<(const FileId& other) const {
    return std::tie(device, inode, name) < std::tie(other.device, other.inode, other.name);
  }
};
// Nothing where the path leads to what many may write to at a time, as a device, or to no place.
std::optional<FileId> identify(const std::string& path);

// A file without a name, for this process alone: it goes away with it, however that ends.
FileHandle anonymous_file();
// A name under which this process can open such a file.
std::string path_of(const FileHandle& file);

}  // namespace l4d::io
