// SPDX-License-Identifier: Apache-2.0
#include "cli/input/frame_files.h"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <map>
#include <optional>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/sequence.h"
#include "cli/text/name_order.h"
#include "cli/text/units.h"
#include "io/formats/scene_file.h"

namespace l4d::cli {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> names_in(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    names.push_back(entry.path().filename().string());
  }
  if (error) throw Failure(L4D_ERR_IO, folder + ": cannot read: " + error.message());
  return names;
}

// The last number in a name, and what stands around it.
struct Numbered {
  std::string before, after;
  unsigned long number = 0;
};
std::optional<Numbered> numbered(const std::string& path) {
  constexpr size_t kMostDigits = 9;
  const std::string name = fs::path(path).filename().string();
  size_t end = name.size();
  while (end > 0 && (name[end - 1] < '0' || name[end - 1] > '9')) --end;
  size_t begin = end;
  while (begin > 0 && name[begin - 1] >= '0' && name[begin - 1] <= '9') --begin;
  if (begin == end || end - begin > kMostDigits) return std::nullopt;
  return Numbered{name.substr(0, begin), name.substr(end),
                  std::stoul(name.substr(begin, end - begin))};
}

// A name with a # for each number in it.
std::string kind_of(const std::string& path) {
  std::string kind;
  for (const char c : fs::path(path).filename().string()) {
    const bool is_digit = c >= '0' && c <= '9';
    if (!is_digit || kind.empty() || kind.back() != '#') kind += is_digit ? '#' : c;
  }
  return kind;
}

// Files that may be of another sequence, or of none.
void note_kinds(Context& context, const std::string& folder,
                const std::vector<std::string>& files) {
  if (std::none_of(files.begin(), files.end(), [](const auto& f) { return numbered(f); })) return;
  std::map<std::string, std::string> kinds;
  for (const std::string& file : files) kinds.emplace(kind_of(file), file);
  if (kinds.size() < 2) return;
  context.note(folder + ": its files have names of " + format_count(kinds.size()) + " kinds, as " +
               kinds.begin()->second + " and " + std::next(kinds.begin())->second +
               "; all are taken as frames of one sequence, in the order of their names");
}

// Names of a folder need no numbers; where they have them, frames may be missing.
void note_gaps(Context& context, const std::string& folder, const std::vector<std::string>& files) {
  size_t missing = 0;
  std::string first;
  for (size_t k = 1; k < files.size(); ++k) {
    const auto a = numbered(files[k - 1]), b = numbered(files[k]);
    if (!a || !b || a->before != b->before || a->after != b->after) return;
    if (b->number == a->number) {
      context.note(folder + ": " + files[k - 1] + " and " + files[k] +
                   " have the same number; both are taken as frames");
    }
    if (b->number <= a->number + 1) continue;
    if (missing == 0) first = files[k - 1];
    missing += b->number - a->number - 1;
  }
  if (missing == 0) return;
  context.note(folder + ": the numbers of its files leave out " + format_count(missing) +
               ", first behind " + first + "; the frames follow each other as if they did not");
}

std::vector<std::string> files_of_folder(Context& context, const std::string& folder) {
  std::vector<std::string> files;
  size_t others = 0;
  for (const std::string& name : names_in(folder)) {
    const std::string path = (fs::path(folder) / name).string();
    std::error_code error;
    const bool is_frame =
        name.front() != '.' && fs::is_regular_file(path, error) && io::is_scene_file(path, path);
    if (is_frame) files.push_back(path);
    others += is_frame ? 0U : 1U;
  }
  if (files.empty()) throw Failure(L4D_ERR_IO, folder + ": the folder has no file of a scene");
  if (others > 0) {
    context.note(folder + ": " + format_count(others) +
                 " entries that are no files of scenes are "
                 "not read");
  }
  std::sort(files.begin(), files.end(), name_is_before);
  note_kinds(context, folder, files);
  note_gaps(context, folder, files);
  return files;
}

std::vector<std::string> files_of_pattern(const std::string& pattern, const NumberedName& name) {
  const std::string folder = fs::path(pattern).parent_path().string();
  std::map<size_t, std::string> found;
  for (const std::string& entry : names_in(folder.empty() ? "." : folder)) {
    const std::string path = folder.empty() ? entry : (fs::path(folder) / entry).string();
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

io::SequenceMatch parse_match(const std::string& text) {
  if (text == "order") return io::SequenceMatch::kOrder;
  if (text == "content") return io::SequenceMatch::kContent;
  if (text == "none") return io::SequenceMatch::kNone;
  return io::SequenceMatch::kAuto;
}

io::SequenceTolerance parse_tolerance(const std::string& text) {
  io::SequenceTolerance tolerance;
  const std::map<std::string, double*> names = {{"position", &tolerance.position},
                                                {"scale", &tolerance.scale},
                                                {"rotation", &tolerance.rotation},
                                                {"color", &tolerance.color},
                                                {"opacity", &tolerance.opacity}};
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find(',', at), text.size());
    const auto [name, value] = parse_assignment(text.substr(at, end - at), "--sequence-error");
    const auto found = names.find(name);
    if (found == names.end()) {
      throw usage_error("--sequence-error: '" + name +
                        "' is none of position, scale, rotation, color and opacity");
    }
    *found->second = parse_number(value, "--sequence-error");
    if (!(*found->second >= 0)) throw usage_error("--sequence-error: " + name + " is below 0");
    at = end + 1;
  }
  return tolerance;
}

}  // namespace

std::vector<std::string> frame_files(Context& context, const std::vector<std::string>& inputs) {
  std::error_code error;
  std::vector<std::string> files;
  const std::string& first = inputs.front();
  if (inputs.size() > 1) {
    files = inputs;
  } else if (fs::is_directory(first, error)) {
    files = files_of_folder(context, first);
  } else if (!fs::exists(first, error)) {
    if (const auto name = NumberedName::parse(first)) files = files_of_pattern(first, *name);
  }
  for (const std::string& file : files) {
    if (file == "-") throw usage_error("a frame of a sequence cannot come from stdin");
    context.files.add_input(file, "a frame");
  }
  return files;
}

void add_sequence_input_options(Verb* verb, SequenceInputArguments& arguments) {
  const char* const group = "Sequences of frames";
  verb->add_option(
          "--match", arguments.match,
          "Which Gaussians of one frame are those of the next: by the order of rows "
          "(order), by what they look like (content), or none; auto takes the order if the "
          "frames agree with it")
      ->type_name("HOW")
      ->one_of({"auto", "order", "content", "none"})
      ->group(group);
  verb->add_option("--sequence-error", arguments.tolerance,
                   "How far a Gaussian may be from that of a frame, separated by commas: position "
                   "(0.1, of its size), scale (0.05, natural logarithm), rotation (2, degrees), "
                   "color (0.01) and opacity (0.01)")
      ->type_name("NAME=VALUE,...")
      ->group(group);
}

LoadedScene load_frames(Context& context, const std::vector<std::string>& files,
                        const ImportArguments& import, const SequenceInputArguments& arguments) {
  import.check();
  io::SequenceOptions options;
  options.paths = files;
  if (!import.fps.empty() && !import.seconds.empty()) {
    throw usage_error("the frames of a sequence have --fps or --seconds, not both");
  }
  if (!import.fps.empty()) {
    options.fps = parse_number(import.fps, "--fps");
  } else if (!import.seconds.empty()) {
    options.fps = static_cast<double>(files.size()) / parse_seconds(import.seconds, "--seconds");
  } else {
    context.note("the sequence has no frame rate; 30 frames per second are assumed");
  }
  options.tolerance = parse_tolerance(arguments.tolerance);
  options.match = parse_match(arguments.match);
  options.activated = import.activated;
  options.threads = static_cast<int>(context.options.threads);
  options.holder = context.budget().holder();
  LoadedScene loaded;
  io::SequenceReport report;
  {
    Progress progress(context, "read");
    options.progress = [&](size_t frame, size_t frames) {
      check_interrupt();
      progress.update(frame, frames, "frames");
    };
    loaded.scene = about("", [&] { return io::read_sequence(options, &report); });
  }
  for (const std::string& note : loaded.scene.notes) context.note(note);
  if (loaded.scene.count() == 0) {
    throw Failure(L4D_ERR_INVALID_SCENE,
                  files.front() + ": the frames hold no Gaussian to be seen");
  }
  context.note(format_count(files.size()) + " frames with " + format_count(report.rows) +
               " Gaussians are " + format_count(loaded.scene.count()) + " Gaussians, " +
               format_count(report.windows) + " of them with a flat window; " +
               (report.in_order
                    ? "rows of one number are taken for one Gaussian"
                    : format_count(report.matched) + " rows go on from a frame before"));
  if (report.unseen > 0) {
    context.note(format_count(report.unseen) + " rows that are fainter than 1/255 are left out");
  }
  return loaded;
}

}  // namespace l4d::cli
