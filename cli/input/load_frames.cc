// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/frame_files.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

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
    options.fps = parse_fps(import.fps, "--fps");
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
  context.note(
      format_items(files.size(), "frame") + " with " + format_items(report.rows, "Gaussian") +
      (files.size() == 1 ? " is " : " are ") + format_items(loaded.scene.count(), "Gaussian") +
      ", " + format_count(report.windows) + " of them with a flat window; " +
      (report.in_order ? "rows of one number are taken for one Gaussian"
                       : format_items(report.matched, "row") +
                             (report.matched == 1 ? " goes" : " go") + " on from a frame before"));
  if (report.unseen > 0) {
    context.note(format_items(report.unseen, "row") +
                 (report.unseen == 1 ? " that is" : " that are") + " fainter than 1/255 " +
                 (report.unseen == 1 ? "is" : "are") + " left out");
  }
  return loaded;
}

}  // namespace l4d::cli
