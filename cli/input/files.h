// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "cli/command/context.h"
#include "io/file/file.h"

namespace l4d::cli {

inline constexpr const char* kTheInput = "the input";

// What help says of an argument that names a scene: "Scene: .l4d, .ply, ...".
std::string scene_help(const std::string& what = "Scene");

// The size of the regular file at `path`. Fails if none is there, or if it cannot be opened. `name`
// stands for the path in messages.
uint64_t require_file(const std::string& path, const std::string& name);

// An input as named on the command line. "-" is stdin, which is copied to an unnamed temporary
// file, because reading a scene needs random access.
class Input {
 public:
  // `what` as CommandFiles has it. Fails if the file is empty, unless `may_be_empty`.
  Input(Context& context, const std::string& name, const std::string& what = kTheInput,
        bool may_be_empty = false);
  const std::string& path() const { return path_; }  // to open
  const std::string& name() const { return name_; }  // to print
  // Whether io::read_scene_file() reads it; else it is a stream.
  bool is_scene() const { return is_scene_; }
  uint64_t bytes() const { return bytes_; }

 private:
  std::string name_;
  std::string path_;
  io::FileHandle spool_;
  bool is_scene_ = false;
  uint64_t bytes_ = 0;
};

// An output as named on the command line, after the rules have been checked: nothing is overwritten
// without --force, an input never, and no binary goes to a terminal. "-" is stdout: the data goes
// to a temporary file, because writers rename, and finish() copies it out.
class Output {
 public:
  // `what` as CommandFiles has it. is_text: it may go to a terminal.
  Output(Context& context, const std::string& name, const std::string& what = "--output",
         bool is_text = false);
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;

  const std::string& path() const { return path_; }  // to write
  bool is_stdout() const { return is_stdout_; }
  // A device or pipe: to be written in place, not renamed over.
  bool is_special() const { return is_special_; }
  // The output is complete. Returns its size in bytes.
  uint64_t finish();

 private:
  std::string path_;
  io::FileHandle spool_;  // of stdout
  bool is_stdout_ = false;
  bool is_special_ = false;
};

// Usage error of `option` where the name's extension promises another kind of file than `written`,
// as ".ply". Other names than those of kinds that are known are left to the user, unless `strict`.
void check_extension(const std::string& name, const char* option,
                     const std::vector<std::string>& written, bool strict = false);
// The same, and where the name is that of a sequence (NumberedName), as it is to be one file.
void check_one_file(const std::string& name, const char* option,
                    const std::vector<std::string>& written);

// The name of the file that a verb writes, checked: as given, else the input's with `extension`, in
// the same folder, whatever else is in the name.
std::string output_name(const std::string& given, const std::string& input,
                        const std::string& extension);

// Random access to a file for the functions of the library that take a reader. Reads fail after
// SIGINT: that is how a call without a progress callback is cancelled.
class FileReader {
 public:
  explicit FileReader(const std::string& path);
  const l4d_reader* get() const { return &reader_; }

 private:
  io::FileHandle file_;
  l4d_reader reader_{};
};

}  // namespace l4d::cli
