// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "io/scene.h"

namespace l4d::io {

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using FileHandle = std::unique_ptr<std::FILE, FileCloser>;

// Sequential input of known length. A pipe has none, so it is read to its end first: whoever parses
// can then always check a count against the bytes that are left before allocating for it.
class InputFile {
 public:
  explicit InputFile(const std::string& path);
  // Bytes in memory; `name` stands for the path in messages.
  InputFile(const std::string& name, std::vector<uint8_t> bytes)
      : path_(name), slurped_(std::move(bytes)), size_(slurped_.size()) {}

  // Returns fewer than `n` bytes only at the end.
  size_t read(void* dst, size_t n);
  uint64_t size() const { return size_; }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  FileHandle file_;
  std::vector<uint8_t> slurped_;  // contents, where file_ is not the source
  uint64_t size_ = 0;
  uint64_t offset_ = 0;
};

std::vector<uint8_t> read_whole_file(const std::string& path);

// Output that appears under its name only when it is complete: written beside it, then renamed.
// Devices and pipes (/dev/null, /dev/stdout) are written directly, because renaming would replace
// them.
class OutputFile {
 public:
  explicit OutputFile(const std::string& path);
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  void write(const void* data, size_t n);
  void commit();

 private:
  std::string path_;            // as the caller named it, for messages
  std::string final_path_;      // symbolic links resolved
  std::string temporary_path_;  // empty: written directly
  FileHandle file_;
};

}  // namespace l4d::io
