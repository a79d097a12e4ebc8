// SPDX-License-Identifier: Apache-2.0
// The file that `encode --live` writes member by member, and its playlist.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cli/input/files.h"
#include "cli/input/member_file.h"
#include "io/file/file.h"

namespace l4d::cli {

struct RecordingNames {
  std::string output;
  std::string playlist;  // "": none
  std::string url;       // of the output, in the playlist; "": its path from there
};

// Both files appear with the first member, in the place of files that were there.
class Recording {
 public:
  // segment: seconds of a media member.
  Recording(Context& context, const RecordingNames& names, double segment);
  ~Recording();
  Recording(const Recording&) = delete;
  Recording& operator=(const Recording&) = delete;

  // A member, of which all bytes are on the disk when this returns.
  void add(const std::vector<uint8_t>& bytes);
  // Writes the index, and ends the playlist: nothing follows. An interrupt does not stop it.
  void finish();

  const std::vector<MemberInfo>& members() const { return members_; }
  size_t num_media() const;
  // From the first span to the last; 0 where there is no media member.
  double begin() const;
  double end() const;
  uint64_t bytes() const { return file_->size(); }

 private:
  void write_playlist(bool complete);

  double segment_;
  Output output_;
  std::optional<Output> playlist_;
  std::optional<io::GrowingFile> file_;
  std::string url_;
  std::vector<MemberInfo> members_;
  uint64_t stream_ = 0;             // what they have in common
  bool is_first_playlist_ = false;  // of no member, where no file was
};

}  // namespace l4d::cli
