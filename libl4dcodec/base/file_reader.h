// SPDX-License-Identifier: Apache-2.0
// The one reader of files of the library.
#pragma once

#include "l4d/l4d.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

// A reader over a file that stays open. Not copyable: it owns the file.
class FileReader {
 public:
  FileReader() = default;
  ~FileReader() { close(); }
  FileReader(const FileReader&) = delete;
  FileReader& operator=(const FileReader&) = delete;
  // path: UTF-8. Fails with IO.
  Status open(const char* path);
  void close();
  // Borrows this object.
  l4d_reader reader();

 private:
#ifdef _WIN32
  void* file_ = nullptr;
#else
  int file_ = -1;
#endif
};

}  // namespace l4d
