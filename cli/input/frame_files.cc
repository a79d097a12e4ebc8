// SPDX-License-Identifier: Apache-2.0
#include "cli/input/frame_files.h"

#include <glob.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>

#include "cli/input/files.h"
#include "cli/input/frame_names.h"
#include "cli/input/sequence.h"
#include "cli/text/name_order.h"
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

// A pattern of the files of scenes in the first of these paths that is a folder with such a file,
// for all folders next to it; "" if there is none.
std::string pattern_in_folders(const std::vector<std::string>& paths) {
  constexpr int kDeepest = 3;
  for (const std::string& path : paths) {
    std::error_code error;
    std::string file;
    for (fs::recursive_directory_iterator at(path, error), end; !error && at != end;
         at.increment(error)) {
      const std::string name = at->path().lexically_relative(path).string();
      if (at.depth() >= kDeepest) at.disable_recursion_pending();
      const bool is_later = file.empty() || name_is_before(file, name);
      if (is_later && io::has_scene_name(name) && at->is_regular_file(error)) file = name;
    }
    if (!file.empty()) return (fs::path(path).parent_path() / "*" / file).string();
  }
  return "";
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
  const std::string pattern = pattern_in_folders(others);
  if (!pattern.empty()) why += ", but folders with some; '" + pattern + "' names one of each";
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
  std::sort(others.begin(), others.end(), name_is_before);
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

// The paths that a pattern of the shell names, in no order.
std::vector<std::string> paths_like(const std::string& pattern) {
  glob_t found{};
  std::vector<std::string> paths;
  if (::glob(pattern.c_str(), GLOB_NOSORT, nullptr, &found) == 0) {
    paths.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  }
  ::globfree(&found);
  return paths;
}

constexpr const char* kNoFile = ": no file has a name of this pattern";

std::vector<std::string> files_of_glob(Context& context, const std::string& pattern) {
  const std::vector<std::string> paths = paths_like(pattern);
  if (paths.empty()) throw Failure(L4D_ERR_IO, pattern + kNoFile);
  return frames_among(context, pattern, paths);
}

// "f_0012.ply is one of %04d": what a pattern that leaves it out would have to be.
std::string other_width(const std::string& path, const std::string& digits) {
  const bool is_padded = digits.size() > 1 && digits.front() == '0';
  return path + " is one of " + (is_padded ? format("%%0%zud", digits.size()) : "%d");
}

std::vector<std::string> files_of_pattern(Context& context, const std::string& pattern,
                                          const NumberedName& name) {
  constexpr size_t kMostDigits = 9;
  std::map<size_t, std::string> found;
  std::string other;
  for (const std::string& path : paths_like(name.glob_pattern())) {
    const std::string digits = name.digits_in(path);
    if (digits.empty() || digits.size() > kMostDigits) continue;
    const size_t number = static_cast<size_t>(std::stoul(digits));
    if (name(number) == path) {
      found.emplace(number, path);
    } else if (other.empty() || name_is_before(path, other)) {
      other = path;
    }
  }
  if (!other.empty()) other = other_width(other, name.digits_in(other));
  if (found.empty()) {
    throw Failure(L4D_ERR_IO, pattern + kNoFile + (other.empty() ? "" : "; " + other));
  }
  if (!other.empty()) context.note(pattern + ": not all numbers are read; " + other);
  std::vector<std::string> files;
  for (const auto& [number, path] : found) {
    const size_t expected = found.begin()->first + files.size();
    if (number != expected) {
      throw usage_error("'" + name(expected) + "' is missing in the sequence '" + pattern + "'" +
                        (other.empty() ? "" : "; " + other));
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
    if (const auto name = NumberedName::parse(first)) {
      files = files_of_pattern(context, first, *name);
    } else if (first.find_first_of("*?[") != std::string::npos) {
      files = files_of_glob(context, first);
    } else if (first.find('%') != first.rfind('%')) {
      throw usage_error("'" + first +
                        "': a name of frames has one %d; a pattern with several * may stand in "
                        "its place");
    }
  }
  for (const std::string& file : files) {
    if (file == "-") throw usage_error("a frame of a sequence cannot come from stdin");
    context.files.add_input(file, "a frame");
    require_frame(file);
  }
  return files;
}

}  // namespace l4d::cli
