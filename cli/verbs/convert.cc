// SPDX-License-Identifier: Apache-2.0
// From any format that is read to any that is written, as the names say.
#include <algorithm>
#include <cctype>
#include <memory>
#include <optional>

#include "cli/command/context.h"
#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/files.h"
#include "cli/input/frame_files.h"
#include "cli/input/instants.h"
#include "cli/input/scene_source.h"
#include "cli/input/sequence.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"
#include "eval/views/views.h"
#include "io/camera/first_view.h"
#include "io/formats/raw_arrays.h"
#include "io/ply/scene_ply.h"
#include "l4d/experimental/parameters.h"

namespace l4d::cli {
namespace {

struct ConvertArguments {
  std::string input, output, time;
  std::string preset = "default";
  ImportArguments import;
  SequenceInputArguments sequence;
};

constexpr const char* kTheOutput = "the output";  // for messages: it is no option here

enum class Target { kStream, kScene, kFreeTime, kSpacetime, kBirths, kArrays, kInstant };

struct Written {
  const char* ending;
  Target target;
};
// Longer endings first.
constexpr Written kWritten[] = {{".ftgs.ply", Target::kFreeTime},
                                {".stg.ply", Target::kSpacetime},
                                {".compressed.ply", Target::kInstant},
                                {".4dgs", Target::kBirths},
                                {".l4d", Target::kStream},
                                {".ply", Target::kScene},
                                {".safetensors", Target::kArrays}};

Target target_of(const std::string& name) {
  for (const Written& written : kWritten) {
    if (ends_in(name, written.ending)) return written.target;
  }
  if (!instant_extension(name).empty()) return Target::kInstant;
  throw usage_error(
      "'" + name +
      "': the name of the output decides what is written; it ends in "
      ".l4d, .ply, .ftgs.ply, .stg.ply, .4dgs, .safetensors, .compressed.ply, .spz, .sog, .glb or "
      ".usda");
}

// Whether its Gaussians stay as they are for the whole sequence.
bool is_static(const io::Scene& scene) {
  if (!scene.window.empty()) return false;
  const double long_time = 8 * io::duration(scene.timeline);
  for (size_t i = 0; i < scene.count(); ++i) {
    for (size_t k = 4; k < 8; ++k) {
      if (scene.rotor[8 * i + k] != 0) return false;
    }
    if (std::exp(static_cast<double>(scene.log_scale[4 * i + 3])) < long_time) return false;
  }
  return true;
}

// A stream of the scene in memory, by which it is sliced.
DecoderHandle decoder_of(Context& context, const io::Scene& scene,
                         std::vector<unsigned char>* stream) {
  *stream = lossless_stream(context, scene, "convert");
  const l4d_decoder_options decoder_options = context.decoder_options();
  DecoderHandle decoder(&decoder_options);
  decoder.open_memory(stream->data(), stream->size());
  return decoder;
}

void write_stream(Context& context, const ConvertArguments& arguments, const io::Scene& scene,
                  const Output& output) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.threads = context.options.threads;
  options.backend = context.backend();
  const EncoderHandle encoder(&options);
  Progress progress(context, "encode");
  encoder.check(l4d_encoder_set_progress(encoder.get(), &Progress::callback, &progress));
  encoder.check(l4d_encoder_set_preset(encoder.get(), arguments.preset.c_str()));
  set_scene(scene, encoder);
  const std::vector<unsigned char> stream = encoder.encode();
  io::OutputFile file(output.path());
  file.write(stream.data(), stream.size());
  file.commit();
}

void write_instants(Context& context, const std::string& name, const io::Scene& scene,
                    const std::vector<double>& times, const std::vector<std::string>& paths,
                    io::WriteNotes* notes) {
  std::vector<unsigned char> stream;
  const DecoderHandle decoder = decoder_of(context, scene, &stream);
  const std::string extension = instant_extension(name);
  notes->emplace(io::loss_of_instants(extension), 0);
  for (size_t k = 0; k < times.size(); ++k) {
    check_interrupt();
    add_notes(io::write_instant_file(
                  paths[k], extension, take_splats(decoder.slice(times[k])),
                  {scene.placement, scene.rendering, scene.presentation.metres_per_unit,
                   context.budget().holder(), check_interrupt}),
              notes);
  }
}

// The instant that a format without time shows.
double instant(Context& context, const ConvertArguments& arguments, const io::Scene& scene) {
  if (!arguments.time.empty()) {
    return clamp_to_sequence(context, scene.timeline, parse_seconds(arguments.time, "--time"),
                             "--time");
  }
  if (!is_static(scene)) {
    throw usage_error("the scene changes over time and '" + arguments.output +
                      "' shows one instant: --time says which");
  }
  return eval::middle_of(scene.timeline);
}

void write(Context& context, const ConvertArguments& arguments, const io::Scene& scene,
           Target target, const Output& output) {
  const bool is_instant = !arguments.time.empty() || is_static(scene);
  switch (target) {
    case Target::kStream:
      return write_stream(context, arguments, scene, output);
    case Target::kFreeTime:
      return write_moving(context, output.path(), scene, io::write_ftgs_ply);
    case Target::kSpacetime:
      return write_moving(context, output.path(), scene, io::write_stg_ply);
    case Target::kBirths:
      return write_births(context, output.path(), scene);
    case Target::kArrays:
      return io::write_raw(output.path(), scene, check_interrupt);
    case Target::kScene:
      if (!is_instant) return io::write_l4d_ply(output.path(), scene, check_interrupt);
      [[fallthrough]];
    case Target::kInstant: {
      io::WriteNotes notes;
      write_instants(context, arguments.output, scene, {instant(context, arguments, scene)},
                     {output.path()}, &notes);
      print_notes(context, notes);
    }
  }
}

// One file for each frame, all of whose names are checked before any is written.
struct Frames {
  Frames(Context& context, const NumberedName& name, size_t count) {
    for (size_t k = 0; k < count; ++k) {
      outputs.push_back(std::make_unique<Output>(context, name(k), kTheOutput));
      paths.push_back(outputs.back()->path());
    }
  }
  uint64_t finish() const {
    uint64_t bytes = 0;
    for (const auto& frame : outputs) bytes += frame->finish();
    return bytes;
  }
  std::vector<std::unique_ptr<Output>> outputs;
  std::vector<std::string> paths;  // of these
};

struct Converted {
  std::string source;
  uint64_t gaussians = 0, bytes = 0;
};

// A file for each frame of the scene.
uint64_t write_frames(Context& context, const ConvertArguments& arguments, const io::Scene& scene,
                      const Frames& frames) {
  const l4d_timeline& timeline = scene.timeline;
  std::vector<double> times;
  for (uint32_t k = 0; k < timeline.num_frames; ++k) {
    times.push_back(timeline.time_begin +
                    static_cast<double>(k) * timeline.fps_den / timeline.fps_num);
  }
  io::WriteNotes notes;
  write_instants(context, arguments.output, scene, times, frames.paths, &notes);
  print_notes(context, notes);
  return frames.finish();
}

// A file for each file: frames that become frames need nothing of those beside them.
Converted convert_each(Context& context, const ConvertArguments& arguments,
                       const std::vector<std::string>& files, const NumberedName& name) {
  for (const std::string& file : files) context.files.add_input(file, "a frame");
  const Frames frames(context, name, files.size());
  Progress progress(context, "convert");
  Converted done;
  io::WriteNotes notes;
  for (size_t k = 0; k < files.size(); ++k) {
    progress.update(k, files.size(), "frames");
    const Input input(context, files[k]);
    const LoadedScene loaded = load_scene(context, input, arguments.import);
    about(input.name(), [&] {
      const double time = instant(context, arguments, loaded.scene);
      write_instants(context, arguments.output, loaded.scene, {time}, {frames.paths[k]}, &notes);
    });
    done.source = loaded.scene.source;
    done.gaussians += loaded.scene.count();
  }
  print_notes(context, notes);
  done.bytes = frames.finish();
  return done;
}

// Usage errors that need no file.
void check(const ConvertArguments& arguments, Target target, bool is_sequence) {
  arguments.import.check();
  const bool is_instant = target == Target::kScene || target == Target::kInstant;
  if (!arguments.time.empty() && !is_instant) {
    throw usage_error("--time is for outputs of one instant: .ply, .spz, .sog, .glb and .usda");
  }
  if (is_sequence && !is_instant) {
    throw usage_error(
        "'" + arguments.output +
        "' names a sequence, whose frames are .ply, .compressed.ply, .spz, .sog, .glb or .usda");
  }
  if (is_sequence && !arguments.time.empty()) NumberedName::refuse(arguments.output);
}

// is_part: of instants, only those that are visible are written.
Outcome describe(const ConvertArguments& arguments, const Converted& done, bool is_part,
                 const Stopwatch& watch) {
  Outcome outcome;
  outcome.json = {{"schema", "l4dcodec.convert/1"},
                  {"input", arguments.input},
                  {"source", done.source.empty() ? "l4d" : done.source},
                  {"output", arguments.output},
                  {"num_gaussians", done.gaussians},
                  {"file_bytes", done.bytes},
                  {"total_s", watch.seconds()}};
  const char* const form =
      is_part ? "%s: of %s what is visible, %s, in %s\n" : "%s: %s, %s, in %s\n";
  outcome.text =
      format(form, arguments.output.c_str(), format_items(done.gaussians, "Gaussian").c_str(),
             format_bytes(done.bytes).c_str(), format_seconds(watch.seconds()).c_str());
  return outcome;
}

Outcome run_convert(Context& context, const ConvertArguments& arguments) {
  const Stopwatch watch;
  const Target target = target_of(arguments.output);
  const std::optional<NumberedName> sequence = NumberedName::parse(arguments.output);
  check(arguments, target, sequence.has_value());
  const std::vector<std::string> frames = frame_files(context, {arguments.input});
  if (frames.empty()) {
    if (arguments.sequence.given()) {
      throw usage_error("--match and --sequence-error need a sequence of frames");
    }
    context.files.add_input(arguments.input, kTheInput);
  }
  if (!sequence && frames.size() > 1 && target == Target::kInstant && arguments.time.empty()) {
    throw usage_error("'" + arguments.output +
                      "' shows one instant of a sequence: --time says which; a name with a %d in "
                      "it is one for each frame");
  }
  if (sequence && !frames.empty() && !arguments.sequence.given()) {
    return describe(arguments, convert_each(context, arguments, frames, *sequence), true, watch);
  }
  std::unique_ptr<Output> output;
  if (!sequence) output = std::make_unique<Output>(context, arguments.output, kTheOutput);
  const Input input(context, frames.empty() ? arguments.input : frames.front());
  LoadedScene loaded = frames.empty()
                           ? load_scene(context, input, arguments.import)
                           : load_frames(context, frames, arguments.import, arguments.sequence);
  check_interrupt();
  l4d_presentation& presentation = loaded.scene.presentation;
  if (target == Target::kStream && presentation.has_camera == 0) {
    io::state_first_view(loaded.scene, &presentation, context.budget().holder());
  }
  Converted done{loaded.scene.source, loaded.scene.count(), 0};
  // What is wrong with their names is not about the input.
  std::optional<Frames> outputs;
  if (sequence) outputs.emplace(context, *sequence, loaded.scene.timeline.num_frames);
  about(input.name(), [&] {
    if (outputs) {
      done.bytes = write_frames(context, arguments, loaded.scene, *outputs);
    } else {
      write(context, arguments, loaded.scene, target, *output);
    }
  });
  if (output) done.bytes = output->finish();
  Outcome outcome = describe(arguments, done, target == Target::kInstant || sequence, watch);
  outcome.stdout_is_data = output != nullptr && output->is_stdout();
  return outcome;
}

}  // namespace

void add_convert(Registry& registry) {
  auto arguments = std::make_shared<ConvertArguments>();
  Verb* verb =
      add_verb(registry, "convert", "Convert a scene to the format that the output's name says",
               [arguments](Context& context) { return run_convert(context, *arguments); });
  verb->add_option(
          "input", arguments->input,
          scene_help() +
              "; or frames of a sequence: a folder, or a pattern as f_%04d.ply or 'n/*/a.ply'")
      ->required();
  verb->add_option(
          "output", arguments->output,
          ".l4d; .ply (l4d_ply, or 3DGS for a static scene and with --time); .ftgs.ply; .stg.ply; "
          ".4dgs; .safetensors (raw arrays); .compressed.ply; .spz; .sog; .glb (glTF with "
          "KHR_gaussian_splatting); "
          ".usda (OpenUSD); with "
          "a %d in it: one of an instant for each frame")
      ->required();
  verb->add_option(
          "--time", arguments->time,
          "The instant that .ply, .compressed.ply, .spz, .sog, .glb and .usda show: 2.5, 1:30")
      ->type_name("T");
  verb->add_option("--preset", arguments->preset, "Of .l4d; `encode` has all parameters")
      ->type_name("NAME")
      ->capture_default_str();
  add_import_options(verb, arguments->import);
  add_sequence_input_options(verb, arguments->sequence);
  verb->footer(
      "Examples:\n"
      "  l4dcodec convert splats.spz splats.ply\n"
      "  l4dcodec convert 'frame_%04d.ply' clip.l4d --fps 30\n"
      "  l4dcodec convert scene.l4d moment.glb --time 2.5\n"
      "  l4dcodec convert scene.l4d frame_%04d.spz\n"
      "What each conversion loses is in docs/formats.md.");
}

}  // namespace l4d::cli
