// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <memory>
#include <optional>

#include "cli/command/context.h"
#include "cli/command/detail.h"
#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/camera_arguments.h"
#include "cli/input/files.h"
#include "cli/input/rendering.h"
#include "cli/input/sequence.h"
#include "cli/input/tolerant.h"
#include "cli/text/units.h"
#include "cli/verbs/frame_sink.h"
#include "cli/verbs/verbs.h"
#include "io/camera/first_view.h"
#include "io/image/video.h"

namespace l4d::cli {
namespace {

struct RenderArguments {
  std::string input;
  std::string output;
  SequenceArguments sequence;
  std::string range;
  std::string cameras;
  bool any_path = false;
  std::string camera;
  bool orbit = false;
  std::string swing;
  std::string size;
  std::string scale;
  std::string background;
  std::string detail = "full";
  uint32_t max_tier = UINT32_MAX;
  bool tolerant = false;
  std::string path = "fast";
  uint32_t crf = io::VideoOptions().crf;
  ImportArguments import;
};

// Cameras of a still, or of a sequence that does not circle, where there is no file of them.
constexpr uint32_t kOrbitCameras = 8;
// An orbit has one ring below this many cameras, and a third of them in the first ring from there.
constexpr uint32_t kRings = 3;
constexpr uint32_t kMaxOrbitSteps = 30000;

constexpr const char* kStages[L4D_RENDER_PASS_BACKWARD] = {"slice", "project", "sort", "bin",
                                                           "blend"};

enum class Target { kStill, kNumbered, kVideo };

Target target_of(const RenderArguments& arguments) {
  const std::string& name = arguments.output;
  check_extension(name, "--output", {".png", ".mp4"}, true);
  std::string end = name.size() > 4 ? name.substr(name.size() - 4) : "";
  std::transform(end.begin(), end.end(), end.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const bool video = end == ".mp4";
  const bool numbered = !video && name.find('%') != std::string::npos;
  const bool range = arguments.sequence.is_range() || !arguments.range.empty();
  const bool still = !arguments.sequence.time.empty();
  if (still && video) throw usage_error("--time is one image; an .mp4 holds a range");
  if (still) NumberedName::refuse(name);
  if (name == "-" && range) throw usage_error("a sequence cannot go to stdout");
  if (video) return Target::kVideo;
  return range || (numbered && !still) ? Target::kNumbered : Target::kStill;
}

// "begin:end" in seconds, either may be empty.
SequenceArguments sequence_of(const RenderArguments& arguments) {
  SequenceArguments sequence = arguments.sequence;
  if (arguments.range.empty()) return sequence;
  const size_t colon = arguments.range.find(':');
  if (colon == std::string::npos || arguments.range.find(':', colon + 1) != std::string::npos) {
    throw usage_error("--range: '" + arguments.range +
                      "' is not begin:end in seconds; --from and --to take minutes too");
  }
  sequence.from = arguments.range.substr(0, colon);
  sequence.to = arguments.range.substr(colon + 1);
  return sequence;
}

double parse_scale(const std::string& text) {
  const double factor = parse_number(text, "--scale");
  if (!(factor > 0)) throw usage_error("--scale must be positive");
  return factor;
}

std::array<float, 3> parse_background(const std::string& text) {
  std::array<float, 3> rgb{};
  size_t begin = 0;
  for (size_t c = 0; c < 3; ++c) {
    const size_t comma = c < 2 ? text.find(',', begin) : text.size();
    if (comma == std::string::npos) throw usage_error("--background takes r,g,b, each 0 to 1");
    const double value = parse_number(text.substr(begin, comma - begin), "--background");
    if (!(value >= 0 && value <= 1)) throw usage_error("--background takes r,g,b, each 0 to 1");
    rgb[c] = static_cast<float>(value);
    begin = comma + 1;
  }
  return rgb;
}

double parse_swing(const std::string& text) {
  const double degrees = parse_number(text, "--swing");
  if (!(degrees > 0 && degrees <= 90)) throw usage_error("--swing takes degrees, up to 90");
  return degrees;
}

// The same view in an image of another size.
void rescale(l4d_camera& camera, double factor) {
  const auto side = [&](uint32_t pixels) {
    const double scaled = std::round(static_cast<double>(pixels) * factor);
    if (scaled > L4D_MAX_IMAGE_SIDE) {
      throw usage_error("--scale: images have at most " + std::to_string(L4D_MAX_IMAGE_SIDE) +
                        " pixels a side");
    }
    return std::max(1u, static_cast<uint32_t>(scaled));
  };
  const uint32_t width = side(camera.width);
  const uint32_t height = side(camera.height);
  const double x = static_cast<double>(width) / static_cast<double>(camera.width);
  const double y = static_cast<double>(height) / static_cast<double>(camera.height);
  camera.width = width;
  camera.height = height;
  camera.fx *= x;
  camera.cx *= x;
  camera.fy *= y;
  camera.cy *= y;
}

const io::Camera& find_camera(const io::CameraSet& set, const std::string& id) {
  if (id.empty()) return set.cameras.front();
  const double number = parse_number(id, "--camera");
  for (const io::Camera& camera : set.cameras) {
    if (static_cast<double>(camera.id) == number) return camera;
  }
  throw usage_error("--camera: there is no camera " + id + " among the " +
                    std::to_string(set.cameras.size()));
}

// One camera, or one for each frame.
struct Path {
  std::vector<l4d_camera> cameras;
  std::optional<int> id;
  const l4d_camera& at(size_t frame, size_t frames) const {
    return cameras[frame * cameras.size() / frames];
  }
};

// The camera of the first view, or with --swing one for each frame: there and back, once.
std::vector<l4d_camera> first_view_path(const RenderArguments& arguments,
                                        const l4d_presentation& first, size_t frames) {
  constexpr double kTurn = 6.283185307179586;
  uint32_t width, height;
  made_up_size(arguments.size, &width, &height);
  const size_t count = arguments.swing.empty() ? 1 : frames;
  const double angle = arguments.swing.empty() ? 0 : parse_swing(arguments.swing) * kTurn / 360;
  std::vector<l4d_camera> cameras;
  for (size_t k = 0; k < count; ++k) {
    const double phase = kTurn * static_cast<double>(k) / static_cast<double>(count);
    cameras.push_back(io::camera_of(io::turned(first, angle * std::sin(phase)), width, height));
  }
  return cameras;
}

Path camera_path(Context& context, const RenderArguments& arguments, const io::CameraSet& given,
                 const eval::RenderedScene& scene, size_t frames) {
  Path path;
  io::CameraSet set;
  const auto instant = [&] {
    return about(arguments.input, [&] { return scene.instant(eval::middle_of(scene.timeline())); });
  };
  const auto orbit = [&](uint32_t count) {
    return about(arguments.input,
                 [&] { return make_orbit(context, instant(), count, arguments.size); });
  };
  // Nobody says from where to look: what the scene states decides, or what there is to see.
  l4d_presentation first = scene.presentation();
  const bool is_free = arguments.cameras.empty() && arguments.camera.empty();
  if (arguments.orbit && frames > 1) {
    const uint32_t steps =
        static_cast<uint32_t>(std::min<size_t>(std::max<size_t>(frames, 4), kMaxOrbitSteps));
    set = orbit(kRings * steps);
    for (uint32_t k = 0; k < steps; ++k) path.cameras.push_back(set.cameras[k].camera);
  } else if (is_free && first.has_camera == 0) {
    io::state_first_view(instant(), &first, context.budget().holder());
    set.notes.push_back("The scene states no first view: this one is made up.");
  }
  if (path.cameras.empty() && is_free && first.has_camera != 0) {
    path.cameras = first_view_path(arguments, first, frames);
  } else if (path.cameras.empty()) {
    set = arguments.cameras.empty() ? orbit(kOrbitCameras) : given;
    const io::Camera& camera = find_camera(set, arguments.camera);
    path.cameras.push_back(camera.camera);
    path.id = camera.id;
  }
  if (!arguments.scale.empty()) {
    const double factor = parse_scale(arguments.scale);
    for (l4d_camera& camera : path.cameras) rescale(camera, factor);
  }
  note_cameras(context, set);
  return path;
}

// Sums over frames.
struct RenderSums {
  uint64_t visible = 0, projected = 0, instances = 0;
  double seconds[L4D_RENDER_PASS_COUNT] = {};
  double render = 0, write = 0;
  uint64_t bytes = 0;  // of all files
  LossReport losses;
  void add(const l4d_render_stats& stats) {
    visible += stats.visible;
    projected += stats.projected;
    instances += stats.instances;
    for (size_t s = 0; s < L4D_RENDER_PASS_COUNT; ++s) seconds[s] += stats.seconds[s];
  }
};

std::vector<std::string> numbered_names(const RenderArguments& arguments, size_t frames) {
  const NumberedName pattern(arguments.output, "out_%04d.png, or out.mp4");
  std::vector<std::string> names;
  for (size_t k = 0; k < frames; ++k) names.push_back(pattern(k));
  return names;
}

// Usage errors that need no file.
void check(const RenderArguments& arguments, Target target, const SequenceArguments& sequence) {
  if (arguments.orbit && target == Target::kStill) {
    throw usage_error("--orbit circles the scene in a video or a sequence");
  }
  if (!arguments.swing.empty()) {
    parse_swing(arguments.swing);
    if (target == Target::kStill) throw usage_error("--swing is for a video or a sequence");
  }
  if (!arguments.size.empty() && !arguments.cameras.empty()) {
    throw usage_error("--size is for made-up cameras; --scale changes those of a file");
  }
  uint32_t width, height;
  if (!arguments.size.empty()) parse_image_size(arguments.size, &width, &height);
  if (!arguments.scale.empty()) parse_scale(arguments.scale);
  sequence.check();
  if (!arguments.background.empty()) parse_background(arguments.background);
  arguments.import.check();
}

io::CameraSet read_cameras(Context& context, const RenderArguments& arguments) {
  if (arguments.cameras.empty()) return {};
  io::CameraSet cameras = read_camera_file(context, arguments.cameras, arguments.any_path);
  find_camera(cameras, arguments.camera);
  return cameras;
}

// Renders and writes all frames.
RenderSums render_frames(Context& context, eval::RenderedScene& scene, const Path& path,
                         const std::vector<double>& times, FrameSink& sink) {
  RenderSums sums;
  io::Image image;
  Progress progress(context, "render");
  for (size_t k = 0; k < times.size(); ++k) {
    check_interrupt();
    progress.update(k, times.size(), "frames");
    const Stopwatch render_watch;
    scene.set_time(times[k]);
    scene.render(path.at(k, times.size()), &image);
    sums.render += render_watch.seconds();
    sums.add(scene.stats());
    scene.for_each_stream(
        [&](const DecoderHandle& decoder, uint64_t offset) { sums.losses.add(decoder, offset); });
    const Stopwatch write_watch;
    sink.write(k, image);
    sums.write += write_watch.seconds();
  }
  for (const auto& [index, why] : scene.left_out()) {
    context.note(scene.name() + ": left out is " + why);
  }
  sums.losses.note(context, scene.name());
  progress.step("writing");
  const Stopwatch write_watch;
  sums.bytes = sink.finish();
  sums.write += write_watch.seconds();
  return sums;
}

// What was rendered, for both forms of the answer.
struct Rendered {
  const std::string& input;
  Target target;
  const Path& path;
  const std::vector<double>& times;
  double frame_rate;
  double open_seconds;
  RenderSums sums;
};

Outcome describe(const RenderArguments& arguments, const Rendered& r, const Stopwatch& watch) {
  const RenderSums& sums = r.sums;
  const l4d_camera& first = r.path.cameras.front();
  const uint64_t frames = r.times.size();
  const double speed = static_cast<double>(frames) / std::max(sums.render, 1e-9);
  const auto mean = [&](uint64_t sum) { return (sum + frames / 2) / frames; };
  Json stages = {{"open", r.open_seconds}};
  for (size_t s = 0; s < L4D_RENDER_PASS_BACKWARD; ++s) stages[kStages[s]] = sums.seconds[s];
  stages["write"] = sums.write;
  Outcome outcome;
  outcome.json = {{"schema", "l4dcodec.render/1"},
                  {"input", r.input},
                  {"output", arguments.output},
                  {"detail", arguments.detail},
                  {"camera", r.path.id ? Json(*r.path.id) : Json(nullptr)},
                  {"width", first.width},
                  {"height", first.height},
                  {"frames", frames},
                  {"time_begin", r.times.front()},
                  {"time_end", r.times.back()},
                  {"frame_rate", r.frame_rate},
                  {"file_bytes", sums.bytes},
                  {"visible", mean(sums.visible)},
                  {"projected", mean(sums.projected)},
                  {"instances", mean(sums.instances)},
                  {"losses", sums.losses.json()},
                  {"passes", stages},
                  {"render_s", sums.render},
                  {"fps", speed},
                  {"total_s", watch.seconds()}};
  const std::string size = format("%u x %u pixels", first.width, first.height);
  const std::string what =
      r.target == Target::kStill
          ? size + " at " + format_time(r.times[0]) + " s"
          : format_count(frames) + (frames == 1 ? " frame of " : " frames of ") + size;
  outcome.text = format(
      "%s: %s, %s\n%s of %s visible Gaussians in the picture, rendered in %s (%s frames per "
      "second)\n",
      arguments.output.c_str(), what.c_str(), format_bytes(sums.bytes).c_str(),
      format_count(mean(sums.projected)).c_str(), format_count(mean(sums.visible)).c_str(),
      format_seconds(sums.render).c_str(), format_number(speed).c_str());
  return outcome;
}

Outcome run_render(Context& context, const RenderArguments& arguments) {
  const Stopwatch watch;
  const Target target = target_of(arguments);
  SequenceArguments sequence = sequence_of(arguments);
  check(arguments, target, sequence);
  context.files.add_input(arguments.input, kTheInput);
  const io::CameraSet cameras = read_cameras(context, arguments);
  std::optional<FrameSink> sink;
  if (target == Target::kNumbered) numbered_names(arguments, 1);
  if (target != Target::kNumbered) sink.emplace(context, std::vector{arguments.output});
  const Input input(context, arguments.input);
  eval::RenderedScene scene =
      render_input(context, input, arguments.import, arguments.path, 1, arguments.tolerant);
  std::array<float, 3> background{};
  if (!arguments.background.empty()) background = parse_background(arguments.background);
  scene.set_background(background.data());
  scene.set_point(operating_point(UINT32_MAX, arguments.max_tier, arguments.detail));
  if (target == Target::kStill && sequence.time.empty()) {
    sequence.time = format("%.17g", eval::middle_of(scene.timeline()));
  }
  const std::vector<double> times = instants(context, sequence, scene.timeline());
  const double frame_rate = sequence_fps(sequence, scene.timeline());
  if (!sink) sink.emplace(context, numbered_names(arguments, times.size()));
  const Path path = camera_path(context, arguments, cameras, scene, times.size());
  if (target == Target::kVideo) {
    const l4d_camera& first = path.cameras.front();
    sink->open_video(first.width, first.height, {frame_rate, arguments.crf});
  }
  const double open_seconds = watch.seconds();
  const RenderSums sums = render_frames(context, scene, path, times, *sink);
  Outcome outcome = describe(
      arguments, {input.name(), target, path, times, frame_rate, open_seconds, sums}, watch);
  outcome.stdout_is_data = sink->is_stdout();
  return outcome;
}

}  // namespace

void add_render(Registry& registry) {
  auto arguments = std::make_shared<RenderArguments>();
  Verb* verb = add_verb(registry, "render", "Render the scene to an image, a sequence or a video",
                        [arguments](Context& context) { return run_render(context, *arguments); });
  verb->add_option("input", arguments->input, scene_help())->required();
  verb->add_option("-o,--output", arguments->output,
                   "PNG to write, '-' = stdout; a sequence needs a %d: out_%04d.png, counted from "
                   "0, or is a video: out.mp4 (made by ffmpeg)")
      ->type_name("FILE")
      ->required();
  add_sequence_options(verb, arguments->sequence);
  auto* range = verb->add_option("--range", arguments->range,
                                 "begin:end in seconds, short for --from and --to")
                    ->type_name("A:B");
  for (const char* other : {"--time", "--from", "--to"}) range->excludes(verb->get_option(other));
  auto* cameras =
      verb->add_option("--cameras", arguments->cameras,
                       cameras_help() +
                           " (default: the first view that the scene states, else one from where "
                           "much of it is seen)")
          ->type_name("FILE");
  add_any_path_option(verb, arguments->any_path)->needs(cameras);
  verb->add_option("--camera", arguments->camera,
                   "Id of the camera: of the file, or of 8 made up around the scene (default: the "
                   "first of the file)")
      ->type_name("ID");
  verb->add_flag("--orbit", arguments->orbit, "Circle the scene once during the sequence")
      ->excludes(cameras)
      ->excludes(verb->get_option("--camera"));
  verb->add_option("--swing", arguments->swing,
                   "Swing by so many degrees to both sides of the first view during the sequence")
      ->type_name("DEGREES")
      ->excludes(cameras)
      ->excludes(verb->get_option("--camera"))
      ->excludes(verb->get_option("--orbit"));
  verb->add_option("--size", arguments->size, "Image size of made-up cameras (default: 640x360)")
      ->type_name("WxH");
  verb->add_option("--scale", arguments->scale, "Factor of the image size: 0.5, 2")->type_name("S");
  verb->add_option("--background", arguments->background,
                   "Colour behind the scene, each 0 to 1 (default: 0,0,0)")
      ->type_name("R,G,B");
  add_tier_option(verb, arguments->max_tier);
  add_detail_option(verb, arguments->detail);
  add_tolerant_option(verb, arguments->tolerant);
  verb->add_option("--path", arguments->path,
                   "Renderer: fast, or reference (double precision, slow, for checking)")
      ->type_name("NAME")
      ->one_of({"fast", "reference"})
      ->capture_default_str();
  verb->add_option("--crf", arguments->crf, "Constant rate factor of a video, 0 (lossless) to 51")
      ->type_name("N")
      ->whole_number(0, 51)
      ->capture_default_str();
  verb->add_option("--seconds", arguments->import.seconds,
                   "Duration to give a scene whose file states no timeline (default: 1)")
      ->type_name("T");
  verb->footer(
      "Examples:\n"
      "  l4dcodec render scene.l4d --time 2.5 -o frame.png\n"
      "  l4dcodec render scene.l4d --cameras cameras.json --camera 3 --range 1:2 -o f_%04d.png\n"
      "  l4dcodec render scene.l4d --swing 12 --size 1280x720 -o scene.mp4\n"
      "The default instant is the middle of the sequence, the default range all of it.\n"
      "Of a stream only what is visible is decoded.");
}

}  // namespace l4d::cli
