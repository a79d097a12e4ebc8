// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "cli/command/context.h"
#include "cli/command/detail.h"
#include "cli/command/progress.h"
#include "cli/input/arrays.h"
#include "cli/input/files.h"
#include "cli/input/instants.h"
#include "cli/input/scene_source.h"
#include "cli/input/sequence.h"
#include "cli/input/shown_scene.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"

namespace l4d::cli {
namespace {

struct SliceArguments {
  std::string input;
  std::string output;
  SequenceArguments sequence;
  std::string detail = "full";
  uint32_t max_tier = UINT32_MAX;
  bool tolerant = false;
  bool digest = false;
  ImportArguments import;
};

// A name of frames, or digests: all frames.
void require_what(const SliceArguments& arguments) {
  if (!arguments.sequence.time.empty() || arguments.sequence.is_range()) return;
  if (arguments.digest || NumberedName::parse(arguments.output)) return;
  throw usage_error("slice needs --time T, or an output name with one %d in it, as out_%04d.ply");
}

// Usage errors that need no file.
void check(const SliceArguments& arguments) {
  const bool single = !arguments.sequence.time.empty();
  require_what(arguments);
  if (arguments.digest != arguments.output.empty()) {
    throw usage_error(arguments.digest
                          ? "--digest hashes slices and writes none: leave out --output"
                          : "--output is required");
  }
  if (!single && arguments.output == "-") throw usage_error("a sequence cannot go to stdout");
  arguments.sequence.check();
  check_extension(arguments.output, "--output", io::instant_extensions());
  if (single && !arguments.digest) NumberedName::refuse(arguments.output);
  arguments.import.check();
}

void note_placement(Context& context, const l4d_placement& p) {
  if (p.scale == 1 && p.origin[0] == 0 && p.origin[1] == 0 && p.origin[2] == 0) return;
  context.note("positions are in the frame of the scene; world = (" +
               format("%.15g, %.15g, %.15g", p.origin[0], p.origin[1], p.origin[2]) + ") + " +
               format("%.15g", p.scale) + " * position");
}

// What the slices of a command came to.
struct Slices {
  Json frames = Json::array();
  uint64_t splats = 0;
  uint64_t bytes = 0;
  uint64_t moved = 0;
  double seconds = 0;
  LossReport losses;
  io::WriteNotes notes;
  std::string digests;
};

// No outputs: digests only.
Slices write_slices(Context& context, const Input& input, ShownScene& scene,
                    const std::vector<double>& times, const std::vector<std::string>& names,
                    const std::vector<std::unique_ptr<Output>>& outputs,
                    const l4d_operating_point& point) {
  Slices slices;
  const io::InstantSetting setting{scene.placement(), scene.rendering(),
                                   scene.presentation().metres_per_unit, context.budget().holder(),
                                   check_interrupt};
  Progress progress(context, "slice");
  for (size_t k = 0; k < times.size(); ++k) {
    check_interrupt();
    progress.update(k, times.size(), "frames");
    const Stopwatch watch;
    const std::shared_ptr<void> memory = context.budget().take(
        about(input.name(), [&] { return scene.slice_bytes(times[k]); }), "a slice");
    SplatArrays arrays =
        about(input.name(), [&] { return scene.slice(times[k], point, &slices.losses); });
    slices.seconds += watch.seconds();
    slices.moved += scene.has_moved() ? 1U : 0U;
    Json frame = {{"index", k}, {"time", times[k]}, {"gaussians", arrays.count()}};
    slices.splats += arrays.count();
    if (outputs.empty()) {
      const Digests digests(arrays_of(std::move(arrays)));
      if (times.size() > 1) {
        slices.digests += format("frame %zu, %s s\n", k, format_time(times[k]).c_str());
      }
      slices.digests += digests.text();
      frame["digests"] = digests.json();
      slices.frames.push_back(frame);
      continue;
    }
    const std::string extension = instant_extension(names[k]);
    add_notes(io::write_instant_file(outputs[k]->path(), extension.empty() ? ".ply" : extension,
                                     take_splats(std::move(arrays)), setting),
              &slices.notes);
    slices.bytes += outputs[k]->finish();
    frame["output"] = names[k];
    slices.frames.push_back(frame);
  }
  return slices;
}

std::string describe(const std::vector<double>& times, const std::vector<std::string>& names,
                     bool single, const Slices& slices) {
  if (single) {
    return format("%s: %s splats at %s s, %s\n", names[0].c_str(),
                  format_count(slices.splats).c_str(), format_time(times[0]).c_str(),
                  format_bytes(slices.bytes).c_str());
  }
  return format("%s .. %s: %s frames, %s splats each on average, %s\n", names.front().c_str(),
                names.back().c_str(), format_count(times.size()).c_str(),
                format_count(slices.splats / times.size()).c_str(),
                format_bytes(slices.bytes).c_str());
}

Outcome run_slice(Context& context, const SliceArguments& arguments) {
  const Stopwatch watch;
  check(arguments);
  const bool single = !arguments.sequence.time.empty();
  context.files.add_input(arguments.input, kTheInput);
  const std::unique_ptr<NumberedName> pattern(
      single || arguments.digest ? nullptr : new NumberedName(arguments.output, "out_%04d.ply"));
  std::vector<std::unique_ptr<Output>> outputs;
  if (single && !arguments.digest)
    outputs.push_back(std::make_unique<Output>(context, arguments.output));
  const Input input(context, arguments.input);
  ShownScene scene(context, input, arguments.import, arguments.tolerant);
  const l4d_operating_point point =
      operating_point(UINT32_MAX, arguments.max_tier, arguments.detail);
  const std::vector<double> times = instants(context, arguments.sequence, scene.timeline());
  note_placement(context, scene.placement());

  // All names are checked before anything is written.
  std::vector<std::string> names;
  for (size_t k = 0; k < times.size() && !arguments.digest; ++k) {
    names.push_back(single ? arguments.output : (*pattern)(k));
    if (k >= outputs.size()) outputs.push_back(std::make_unique<Output>(context, names[k]));
  }
  const Slices slices = write_slices(context, input, scene, times, names, outputs, point);
  slices.losses.note(context, input.name());
  print_notes(context, slices.notes);
  if (slices.moved > 0) {
    context.note("instants that lie between the streams of the file: " +
                 format_count(slices.moved) + "; the nearest that a stream has are shown");
  }
  if (arguments.digest) {
    context.note(
        "slices are not normative: equal digests tell that builds of this library agree, "
        "different ones of another decoder nothing");
  }

  Outcome outcome;
  outcome.stdout_is_data = !outputs.empty() && outputs[0]->is_stdout();
  outcome.json = {{"schema", "l4dcodec.slice/1"},
                  {"input", input.name()},
                  {"detail", arguments.detail},
                  {"num_frames", times.size()},
                  {"frames", slices.frames},
                  {"file_bytes", slices.bytes},
                  {"buckets_decoded", scene.buckets_decoded()},
                  {"cache_hits", scene.cache_hits()},
                  {"losses", slices.losses.json()},
                  {"slice_s", slices.seconds},
                  {"total_s", watch.seconds()}};
  outcome.text_is_asked_for = arguments.digest;
  outcome.text = arguments.digest ? slices.digests : describe(times, names, single, slices);
  return outcome;
}

}  // namespace

void add_slice(Registry& registry) {
  auto arguments = std::make_shared<SliceArguments>();
  Verb* verb =
      add_verb(registry, "slice", "Write the scene at an instant, or at many, as static files",
               [arguments](Context& context) { return run_slice(context, *arguments); });
  verb->add_option("input", arguments->input, scene_help())->required();
  verb->add_option(
          "-o,--output", arguments->output,
          "What to write, by its name: .ply (3DGS), .compressed.ply, .spz, .sog, .glb (glTF) or "
          ".usda (OpenUSD); '-' = 3DGS PLY to stdout. "
          "A sequence, all frames unless --from, --to or --fps is given, needs a %d: out_%04d.ply, "
          "counted from 0. Required unless --digest is given")
      ->type_name("FILE");
  verb->add_flag("--digest", arguments->digest,
                 "Write nothing and print XXH3-64 of each array of the slice. Slices are not "
                 "normative: this is for comparing builds of this library");
  add_sequence_options(verb, arguments->sequence);
  add_tier_option(verb, arguments->max_tier);
  add_detail_option(verb, arguments->detail);
  add_tolerant_option(verb, arguments->tolerant);
  verb->add_option("--seconds", arguments->import.seconds,
                   "Duration to give a scene whose file states no timeline (default: 1)")
      ->type_name("T");
  verb->footer(
      "Examples:\n"
      "  l4dcodec slice scene.l4d --time 2.5 -o frame.ply\n"
      "  l4dcodec slice scene.l4d -o frame_%04d.ply\n"
      "  l4dcodec slice scene.l4d --from 1 --to 2 --fps 30 -o frame_%04d.spz\n"
      "Each bucket of a sequence is decoded once. Opacity has the temporal falloff applied.");
}

}  // namespace l4d::cli
