// SPDX-License-Identifier: Apache-2.0
#include "cli/input/frame_files.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>

#include "cli/input/files.h"
#include "cli/input/frame_names.h"
#include "cli/input/sequence.h"
#include "cli/text/units.h"
#include "io/file/file_kind.h"
#include "io/formats/scene_file.h"

namespace l4d::cli {
namespace {

namespace fs = std::filesystem;

// Fails with the reason if a file is no frame, before others are read.
void require_frame(const std::string& path) {
  if (require_file(path, path) == 0) throw Failure(L4D_ERR_CORRUPT, path + ": the file is empty");
  if (io::is_scene_file(path, path)) return;
  if (io::is_stream(path)) {
    throw Failure(L4D_ERR_FEATURE_UNSUPPORTED,
                  path +
                      ": this is a stream, and no frame of a sequence; `l4dcodec concat` joins "
                      "streams");
  }
  about("", [&] { io::read_scene_file(path, path); });  // says what it is
}

// Fails with what else a folder has that holds no frame.
[[noreturn]] void fail_without_frames(const std::string& where,
                                      const std::vector<std::string>& others) {
  std::string why = "no file of a scene is there";
  for (const std::string& path : others) {
    std::error_code error;
    if (fs::is_regular_file(path, error) && io::is_stream(path)) {
      throw Failure(L4D_ERR_IO, where + ": " + why + ", but streams, as " + path +
                                    "; `l4dcodec concat` joins streams");
    }
  }
  throw Failure(L4D_ERR_IO, where + ": " + why);
}

// The frames among the files that were found, in their order. What has the name of a scene is one,
// so that none is lost that is damaged; the rest is named in a note.
std::vector<std::string> frames_among(Context& context, const std::string& where,
                                      const std::vector<std::string>& paths) {
  std::vector<std::string> files, others;
  for (const std::string& path : paths) {
    std::error_code error;
    const bool is_hidden = fs::path(path).filename().string().front() == '.';
    const bool is_frame = !is_hidden && !fs::is_directory(path, error) &&
                          (io::has_scene_name(path) ||
                           (fs::is_regular_file(path, error) && io::is_scene_file(path, path)));
    (is_frame ? files : others).push_back(path);
  }
  std::sort(others.begin(), others.end());
  if (files.empty()) fail_without_frames(where, others);
  if (!others.empty()) {
    const std::string first = fs::path(others.front()).filename().string();
    context.note(where + ": " +
                 (others.size() == 1 ? "1 entry that is no scene is not read: "
                                     : format_count(others.size()) +
                                           " entries that are no scenes are not read, as ") +
                 first);
  }
  order_frames(&files);
  note_frame_names(context, where, files);
  return files;
}

std::vector<std::string> paths_in(const std::string& folder) {
  std::vector<std::string> paths;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    paths.push_back((fs::path(folder) / entry.path().filename()).string());
  }
  if (error) throw Failure(L4D_ERR_IO, folder + ": cannot read: " + error.message());
  return paths;
}

std::vector<std::string> files_of_pattern(const std::string& pattern, const NumberedName& name) {
  const std::string folder = fs::path(pattern).parent_path().string();
  std::map<size_t, std::string> found;
  for (const std::string& there : paths_in(folder.empty() ? "." : folder)) {
    const std::string entry = fs::path(there).filename().string();
    const std::string path = folder.empty() ? entry : there;
    // The number is the run of digits at which the two names meet again.
    for (size_t at = 0; at < entry.size(); ++at) {
      constexpr size_t kMostDigits = 9;
      if (entry[at] < '0' || entry[at] > '9') continue;
      size_t end = at;
      while (end < entry.size() && entry[end] >= '0' && entry[end] <= '9') ++end;
      if (end - at > kMostDigits) break;
      const size_t number = static_cast<size_t>(std::stoul(entry.substr(at, end - at)));
      if (name(number) == path) found.emplace(number, path);
      at = end;
    }
  }
  if (found.empty()) throw Failure(L4D_ERR_IO, pattern + ": no file has a name of this pattern");
  std::vector<std::string> files;
  for (const auto& [number, path] : found) {
    const size_t expected = found.begin()->first + files.size();
    if (number != expected) {
      throw usage_error("'" + name(expected) + "' is missing in the sequence '" + pattern + "'");
    }
    files.push_back(path);
  }
  return files;
}

}  // namespace

std::vector<std::string> frame_files(Context& context, const std::vector<std::string>& inputs) {
  std::error_code error;
  std::vector<std::string> files;
  const std::string& first = inputs.front();
  if (inputs.size() > 1) {
    files = inputs;
    note_listed_order(context, files);
  } else if (fs::is_directory(first, error)) {
    files = frames_among(context, first, paths_in(first));
  } else if (!fs::exists(first, error)) {
    if (const auto name = NumberedName::parse(first)) files = files_of_pattern(first, *name);
  }
  for (const std::string& file : files) {
    if (file == "-") throw usage_error("a frame of a sequence cannot come from stdin");
    context.files.add_input(file, "a frame");
    require_frame(file);
  }
  return files;
}

}  // namespace l4d::cli
