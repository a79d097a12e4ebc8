// SPDX-License-Identifier: Apache-2.0
#include "cli/input/scene_source.h"

#include <algorithm>
#include <cmath>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/member_file.h"
#include "cli/text/units.h"
#include "io/formats/scene_file.h"
#include "l4d/experimental/parameters.h"

namespace l4d::cli {
namespace {

io::ImportOptions parse(const ImportArguments& arguments) {
  arguments.check();
  io::ImportOptions options;
  if (!arguments.seconds.empty()) options.seconds = parse_seconds(arguments.seconds, "--seconds");
  if (!arguments.fps.empty()) options.fps = parse_fps(arguments.fps, "--fps");
  options.activated = arguments.activated;
  return options;
}

void note_unused(Context& context, const Input& input, const ImportArguments& arguments,
                 const l4d_timeline& timeline, const std::string& source) {
  io::ImportOptions options = parse(arguments);
  // Times of cameras that state none have a use for it.
  if (arguments.cameras != nullptr && !arguments.cameras->empty()) options.seconds = 0;
  for (const std::string& text : io::unused_options(options, timeline, source)) {
    context.note(input.name() + ": " + text);
  }
}

io::Scene import_scene(Context& context, const Input& input, const ImportArguments& arguments) {
  io::ImportOptions options = parse(arguments);
  options.holder = context.budget().holder();
  options.reads = [&](const std::string& path) {
    context.files.keep(path, "a file that the input names");
  };
  io::Scene scene;
  {
    Progress progress(context, "read");
    progress.step("reading");
    scene = about(input.name(),
                  [&] { return io::read_scene_file(input.path(), input.name(), options); });
  }
  check_interrupt();
  if (scene.count() == 0 && !arguments.may_be_empty) {
    throw Failure(L4D_ERR_INVALID_SCENE, input.name() + ": the scene holds no Gaussian");
  }
  for (const std::string& note : scene.notes) context.note(note);
  note_unused(context, input, arguments, scene.timeline, scene.source);
  return scene;
}

}  // namespace

void ImportArguments::check() const {
  if (!seconds.empty() && !(parse_seconds(seconds, "--seconds") > 0)) {
    throw usage_error("--seconds must be positive");
  }
  if (!fps.empty()) parse_fps(fps, "--fps");
}

void add_import_options(Verb* verb, ImportArguments& arguments, const std::string* cameras) {
  const bool takes_cameras = cameras != nullptr;
  arguments.cameras = cameras;
  const std::string group =
      takes_cameras ? "Times that files do not state" : "Import of files that state no timeline";
  verb->add_option(
          "--seconds", arguments.seconds,
          takes_cameras
              ? "What 1 in the times of D-NeRF cameras stands for, as for "
                "l4dtrain, and the duration of a scene whose file states no "
                "timeline (default: 1), or of a sequence of frames, whose rate follows from it"
              : "Duration of the sequence (default: 1); of a sequence of frames, whose rate "
                "follows from it")
      ->type_name("T")
      ->group(group);
  verb->add_option(
          "--fps", arguments.fps,
          "Frame rate of such a scene, and of a sequence of frames: 25, 30000/1001 (default: 30)")
      ->type_name("F")
      ->group(group);
  verb->add_flag("--activated", arguments.activated,
                 "The PLY has opacities of 0 to 1 and lengths in the columns for logits and "
                 "logarithms")
      ->group(group);
}

void note_unused(Context& context, const Input& input, const ImportArguments& arguments,
                 const l4d_timeline& timeline) {
  note_unused(context, input, arguments, timeline, "l4d");
}

LoadedScene load_scene(Context& context, const Input& input, const ImportArguments& arguments) {
  if (input.is_scene()) {
    LoadedScene loaded;
    loaded.scene = import_scene(context, input, arguments);
    return loaded;
  }
  return about(input.name(), [&] {
    const l4d_decoder_options options = context.decoder_options();
    const DecoderHandle decoder(&options);
    Progress progress(context, "read");
    decoder.check(l4d_decoder_set_progress(decoder.get(), &Progress::callback, &progress));
    decoder.check(l4d_decoder_open_file(decoder.get(), input.path().c_str()));
    LoadedScene loaded = decode_scene(context, decoder);
    present(context, input, &loaded);
    note_unused(context, input, arguments, loaded.scene.timeline);
    return loaded;
  });
}

void set_scene(const io::Scene& scene, const EncoderHandle& encoder) {
  const l4d_gaussians view = scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &scene.timeline, &scene.placement));
  encoder.check(l4d_encoder_set_rendering(encoder.get(), &scene.rendering));
  encoder.check(l4d_encoder_set_presentation(encoder.get(), &scene.presentation));
}

std::vector<unsigned char> lossless_stream(Context& context, const io::Scene& scene,
                                           const char* verb) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.threads = context.options.threads;
  const EncoderHandle encoder(&options);
  Progress progress(context, verb);
  encoder.check(l4d_encoder_set_progress(encoder.get(), &Progress::callback, &progress));
  encoder.check(l4d_encoder_set_preset(encoder.get(), "lossless"));
  // Speed is all that counts.
  encoder.set(L4D_ENC_ZSTD_LEVEL, 1);
  set_scene(scene, encoder);
  return encoder.encode();
}

LoadedScene decode_scene(Context& context, const DecoderHandle& decoder, const l4d_query* query) {
  return eval::decode_scene(decoder, query, context.budget().holder());
}

SceneStream::SceneStream(Context& context, const Input& input, const ImportArguments& arguments)
    : decoder_([&] {
        const l4d_decoder_options options = context.decoder_options();
        return DecoderHandle(&options);
      }()) {
  if (!input.is_scene()) {
    about(input.name(), [&] {
      decoder_.open_file(input.path());
      note_members(context, input, decoder_.info().timeline);
    });
    note_unused(context, input, arguments, decoder_.info().timeline);
    source_ = "l4d";
  } else {
    const io::Scene scene = import_scene(context, input, arguments);
    source_ = scene.source;
    about(input.name(), [&] { stream_ = lossless_stream(context, scene, "read"); });
    decoder_.open_memory(stream_.data(), stream_.size());
  }
  info_ = decoder_.info();
}

double frames_per_second(const l4d_timeline& timeline) {
  return static_cast<double>(timeline.fps_num) / static_cast<double>(timeline.fps_den);
}

std::string describe_timeline(const l4d_timeline& timeline) {
  const std::string from =
      timeline.time_begin == 0 ? "" : " from " + format_time(timeline.time_begin) + " s";
  return format_number(io::duration(timeline)) + " s" + from + ", " +
         format_items(timeline.num_frames, "frame") + " at " +
         format_number(frames_per_second(timeline)) + " fps";
}

Json timeline_json(const l4d_timeline& timeline) {
  return {{"time_begin", timeline.time_begin},
          {"num_frames", timeline.num_frames},
          {"fps", frames_per_second(timeline)},
          {"fps_rational", {timeline.fps_num, timeline.fps_den}},
          {"duration_s", io::duration(timeline)}};
}

double clamp_to_sequence(Context& context, const l4d_timeline& timeline, double seconds,
                         const char* option) {
  const double begin = timeline.time_begin;
  const double end = begin + io::duration(timeline);
  const double clamped = std::clamp(seconds, begin, end);
  if (clamped != seconds) {
    context.note(std::string(option) + " " + format_time(seconds) + " lies outside the sequence [" +
                 format_time(begin) + ", " + format_time(end) + "]; " + format_time(clamped) +
                 " is used");
  }
  return clamped;
}

}  // namespace l4d::cli
