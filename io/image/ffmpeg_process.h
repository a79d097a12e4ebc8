// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <string>
#include <vector>

#include "io/file/file.h"

namespace l4d::io {

// A run of ffmpeg with one stream of bytes to or from this process.
class FfmpegProcess {
 public:
  enum class Direction { kFrom, kTo };

  // `arguments` follow the program's name. `subject` begins messages: the video's path. `extra`: a
  // file that ffmpeg gets as its descriptor kExtra, or null. Throws Error(L4D_ERR_IO) where ffmpeg
  // is missing.
  FfmpegProcess(const std::string& subject, const std::vector<std::string>& arguments,
                Direction direction, std::FILE* extra = nullptr);
  static constexpr int kExtra = 3;
  ~FfmpegProcess();  // ends a run that goes on
  FfmpegProcess(const FfmpegProcess&) = delete;
  FfmpegProcess& operator=(const FfmpegProcess&) = delete;

  // Returns fewer than `n` bytes only at the end of the stream.
  size_t read(void* dst, size_t n);
  // Throws ffmpeg's own words where it stopped reading.
  void write(const void* data, size_t n);
  // Closes the stream and waits; throws unless ffmpeg says that all went well.
  void finish();
  // Throws `what` and ffmpeg's own words, after finish().
  [[noreturn]] void fail(const std::string& what);
  // What it has said, after finish(): errors, of which it may say that all went well.
  std::string words();

 private:
  void close_stream();
  int wait();  // exit status; negative where a signal ended it
  [[noreturn]] void fail_with_words(int exit_status);

  std::string subject_;
  FileHandle errors_;  // what ffmpeg writes to its standard error
  int stream_ = -1;
  pid_t pid_ = -1;
};

}  // namespace l4d::io
