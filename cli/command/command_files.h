// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "io/file/file.h"

namespace l4d::cli {

// Everything that a command reads and writes, by what it is and not by how it is named. Nothing
// that is read may be written, and nothing may be written twice: verbs add all their files before
// they begin to work, and whatever comes second throws a usage error.
class CommandFiles {
 public:
  // `what` stands for the file in messages: "the input", "--weights". "-" is stdin. Throws where
  // the file is not there or must not be read.
  void add_input(const std::string& path, const std::string& what);
  // A file that the command may come to read.
  void keep(const std::string& path, const std::string& what) { add(path, {what, false}); }
  // "-" is stdout, which is what it is from the beginning on.
  void add_output(const std::string& path, const std::string& what);

 private:
  struct Entry {
    std::string what;
    bool is_output;
  };
  void add(const std::string& path, const Entry& entry);

  std::map<io::FileId, Entry> entries_;
};

}  // namespace l4d::cli
