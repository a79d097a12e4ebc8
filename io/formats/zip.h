// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "io/file/file.h"
#include "io/file/memory.h"

namespace l4d::io {

// Files of a ZIP archive in memory: stored or deflated, without encryption and ZIP64. Every offset
// and length is compared with the bytes that there are; a file is no longer than its entry says,
// and has the checksum that it says. Throws Error in the name of `name`.
class ZipArchive {
 public:
  ZipArchive(std::vector<uint8_t> bytes, std::string name);

  bool has(const std::string& file) const { return entries_.count(file) > 0; }
  // memory: counts the bytes of the file before they are there. Fails with L4D_ERR_LIMIT_EXCEEDED
  // if they are more than `most`.
  std::vector<uint8_t> read(const std::string& file, const Hold& holder,
                            std::shared_ptr<void>* memory, uint64_t most = UINT32_MAX) const;

 private:
  struct Entry {
    uint16_t method = 0;
    uint32_t checksum = 0, stored = 0, size = 0, header = 0;
  };
  [[noreturn]] void fail(l4d_status status, const std::string& message) const;
  const uint8_t* at(uint64_t offset, uint64_t size, const char* what) const;
  uint64_t find_end() const;

  std::vector<uint8_t> bytes_;
  std::string name_;
  std::map<std::string, Entry> entries_;
};

// Writes an archive of files that are stored as they are. Equal files give equal bytes: its times
// are those of 1980. Fails with L4D_ERR_LIMIT_EXCEEDED where it would need ZIP64.
class ZipWriter {
 public:
  explicit ZipWriter(const std::string& path) : path_(path), file_(path) {}

  void add(const std::string& file, const void* data, size_t size);
  void commit();

 private:
  void write(const std::vector<uint8_t>& bytes);

  std::string path_;
  OutputFile file_;
  uint64_t offset_ = 0;
  uint16_t files_ = 0;
  std::vector<uint8_t> directory_;
};

}  // namespace l4d::io
