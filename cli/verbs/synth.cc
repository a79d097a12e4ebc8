// SPDX-License-Identifier: Apache-2.0
#include "io/synth/synth.h"

#include <algorithm>
#include <array>
#include <memory>

#include "cli/command/context.h"
#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/files.h"
#include "cli/input/scene_source.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"
#include "io/ply/scene_ply.h"

namespace l4d::cli {
namespace {

struct SynthArguments {
  std::string seconds = "5";
  std::string fps = "30";
  std::string gaussians = "100k";
  std::string static_gaussians;
  std::string scene = "square";
  std::string cameras_out;
  std::vector<std::string> effects;
  uint64_t seed = 1;
  std::string output;
};

const std::array<const char*, 7>& effects_of(const std::string& scene) {
  return scene == "cloud" ? io::kSynthEffects : io::kPlaceEffects;
}

std::string effect_names(const std::string& scene) {
  std::string names;
  for (const char* effect : effects_of(scene))
    names += (names.empty() ? "" : ", ") + std::string(effect);
  return names;
}

Outcome run_synth(Context& context, const SynthArguments& arguments) {
  const Stopwatch watch;
  io::SynthOptions options;
  options.scene = arguments.scene;
  options.check = check_interrupt;
  options.threads = static_cast<int>(context.options.threads);
  options.seconds = parse_seconds(arguments.seconds, "--seconds");
  options.fps = parse_fps(arguments.fps, "--fps");
  options.gaussians = parse_size(arguments.gaussians, "--gaussians");
  if (!arguments.static_gaussians.empty()) {
    options.static_gaussians = parse_size(arguments.static_gaussians, "--static-gaussians");
  }
  options.seed = arguments.seed;
  options.effects = arguments.effects;
  if (!(options.seconds > 0)) throw usage_error("--seconds must be positive");
  if (options.gaussians == 0) throw usage_error("--gaussians must be positive");
  if (options.scene != "square" && options.scene != "room" && options.scene != "cloud") {
    throw usage_error("--scene: '" + options.scene + "' is none of square, room, cloud");
  }
  const auto& known = effects_of(options.scene);
  for (const std::string& effect : options.effects) {
    if (std::find(known.begin(), known.end(), effect) == known.end()) {
      throw usage_error("--effects: '" + effect + "' is none of " + effect_names(options.scene));
    }
  }
  const bool place = options.scene != "cloud";
  if (place && options.static_gaussians > 0) {
    throw usage_error("--static-gaussians: only --scene cloud has them");
  }
  if (!place && !arguments.cameras_out.empty()) {
    throw usage_error("--cameras-out: --scene cloud has none");
  }
  check_one_file(arguments.output, "--output", {".ply"});
  Output output(context, arguments.output);
  std::unique_ptr<Output> cameras;
  if (!arguments.cameras_out.empty()) {
    check_extension(arguments.cameras_out, "--cameras-out", {".json"});
    cameras = std::make_unique<Output>(context, arguments.cameras_out, "--cameras-out");
  }
  io::Scene scene;
  {
    Progress progress(context, "synth");
    progress.step("generating");
    scene = io::synthesize(options);
    check_interrupt();
    progress.step("writing");
    io::write_l4d_ply(output.path(), scene, check_interrupt);
    if (cameras) io::write_place_cameras(cameras->path(), options.scene, scene.timeline);
  }
  if (cameras) cameras->finish();
  const uint64_t bytes = output.finish();

  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  outcome.json = {{"schema", "l4dcodec.synth/1"},
                  {"output", arguments.output},
                  {"num_gaussians", scene.count()},
                  {"sh_degree", scene.sh_degree}};
  outcome.json.update(timeline_json(scene.timeline));
  outcome.json["effects"] = options.effects.empty()
                                ? Json(std::vector<std::string>(known.begin(), known.end() - 1))
                                : Json(options.effects);
  outcome.json["scene"] = options.scene;
  outcome.json["seed"] = options.seed;
  outcome.json["file_bytes"] = bytes;
  outcome.json["total_s"] = watch.seconds();
  outcome.text =
      format("%s: %s Gaussians, %s, SH degree %u, %s\n", arguments.output.c_str(),
             format_count(scene.count()).c_str(), describe_timeline(scene.timeline).c_str(),
             scene.sh_degree, format_bytes(bytes).c_str());
  return outcome;
}

}  // namespace

void add_synth(Registry& registry) {
  auto arguments = std::make_shared<SynthArguments>();
  Verb* verb = add_verb(registry, "synth", "Make a deterministic synthetic scene",
                        [arguments](Context& context) { return run_synth(context, *arguments); });
  verb->add_option("-o,--output", arguments->output, "PLY to write, '-' = stdout")
      ->type_name("FILE")
      ->required();
  verb->add_option(
          "--scene", arguments->scene,
          "square: a market square at dusk; room: a living room in the evening; both to look at.\n"
          "More than 20 s (for more than some 500k Gaussians the more) are slow motion there.\n"
          "cloud: random surfaces, as hard to code as trained scenes")
      ->type_name("NAME")
      ->capture_default_str();
  verb->add_option("--cameras-out", arguments->cameras_out,
                   "Cameras of square or room, as cameras.json: named views from id 0, a ring for\n"
                   "training from 100, a walk from 200")
      ->type_name("FILE");
  verb->add_option("--seconds", arguments->seconds, "Duration: 5, 1:30, 2:00:00")
      ->type_name("T")
      ->capture_default_str();
  verb->add_option("--fps", arguments->fps, "Frame rate")->type_name("F")->capture_default_str();
  verb->add_option("-n,--gaussians", arguments->gaussians, "Gaussians: 100k, 2M")
      ->type_name("N")
      ->capture_default_str();
  verb->add_option(
          "--static-gaussians", arguments->static_gaussians,
          "How many of them are the room, for scenes that differ in length alone (default: a\n"
          "fixed share of all)")
      ->type_name("N");
  verb->add_option("--effects", arguments->effects,
                   "What the scene has, comma-separated: " + effect_names("square") +
                       " (default: all\nbut frames); the cloud has appear and no drops")
      ->type_name("LIST")
      ->delimiter(',')
      ->allow_extra_args(false);
  verb->add_option("--seed", arguments->seed, "Equal seeds give equal files on every machine")
      ->type_name("N")
      ->whole_number(0)
      ->capture_default_str();
  verb->footer(
      "Example:\n"
      "  l4dcodec synth -n 500k --cameras-out cameras.json -o square.ply\n"
      "  l4dcodec synth --scene room -n 300k --cameras-out cameras.json -o room.ply\n"
      "  l4dcodec synth --scene cloud --seconds 10:00 -n 1M -o long.ply");
}

}  // namespace l4d::cli
