// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace l4d::cli {

// What tells one state of an open file from another.
struct FileState {
  uint64_t size = 0;
  uint64_t modified = 0;  // nanoseconds since 1970
  // Whether `modified` is so far from when it was looked at that another change would show.
  bool is_settled = false;
  bool operator==(const FileState& b) const { return size == b.size && modified == b.modified; }
};
// Size 0 where the file cannot be looked at.
FileState state_of(int fd);

// An open file that is closed with its last owner.
struct ServedFile {
  int fd = -1;
  FileState state;
  std::string tag;  // ETag: another one where the file is another one or has changed
  ServedFile() = default;
  ServedFile(const ServedFile&) = delete;
  ServedFile& operator=(const ServedFile&) = delete;
  ~ServedFile();
};

// What lies in a folder or in folders within it. Names are relative, with "/" between segments.
// Nothing outside of the folder is reached, also through links, and no name of which a segment
// begins with a dot.
class Folder {
 public:
  // Throws std::filesystem::filesystem_error where there is no such folder.
  explicit Folder(const std::string& path) : path_(std::filesystem::canonical(path)) {}

  // Null where there is no regular file of this name that can be read.
  std::shared_ptr<ServedFile> open(const std::string& name) const;
  bool has_file(const std::string& name) const;
  // Where a file is, "" where there is none.
  std::string path_of(const std::string& name) const;
  // "": the folder itself.
  bool has_folder(const std::string& name) const;

  struct Entry {
    std::string name;  // of one segment
    bool is_folder = false;
  };
  // The streams (*.l4d), the playlists (*.m3u8) and the folders of a folder, by name. What cannot
  // be read is left out.
  std::vector<Entry> list(const std::string& name) const;
  // Whether it lists a stream or a playlist, or a folder within it does, or whether there is more
  // in it than anybody waits for.
  bool may_have_streams() const;

 private:
  std::filesystem::path find(const std::string& name) const;

  std::filesystem::path path_;
};

}  // namespace l4d::cli
