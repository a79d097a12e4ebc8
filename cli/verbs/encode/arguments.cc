// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/arguments.h"

#include <filesystem>

namespace l4d::cli {
namespace {

// Finds the errors in options of weights that need no input file.
void check_importance(const EncodeArguments& arguments, const std::optional<eval::Target>& target) {
  const bool measures = arguments.measures();
  arguments.cameras.check();
  if (arguments.cameras.orbit > 0 && !measures && !(target && target->needs_views())) {
    throw usage_error(
        "--weights excludes --orbit, unless for --target-fidelity or "
        "--target-psnr-loss");
  }
  arguments.measure.check();
  if (!measures && arguments.measure.given()) {
    throw usage_error(
        "--agreement, --all-views, --max-share, --visibility and --metric need --cameras");
  }
  if (!measures && !arguments.save_weights.empty()) {
    throw usage_error("--save-weights needs --cameras");
  }
  if (arguments.estimate && (measures || !arguments.weights.empty())) {
    throw usage_error("--estimate excludes --cameras, --orbit and --weights");
  }
  if (const std::string obstacle = refit_obstacle(arguments, target);
      !arguments.refit.empty() && arguments.refit != "0" && !obstacle.empty()) {
    throw usage_error("--refit " + obstacle);
  }
  if (!measures && arguments.weights.empty() && arguments.no_prune) {
    throw usage_error("--no-prune needs --weights or --cameras");
  }
  if (arguments.parameters.prune_weight.empty()) return;
  if (arguments.no_prune) throw usage_error("--prune-weight excludes --no-prune");
  if (!measures && arguments.weights.empty()) {
    throw usage_error("--prune-weight needs --weights or --cameras");
  }
}

void add_weight_options(Verb* verb, EncodeArguments& arguments) {
  verb->add_option(
          "--weights", arguments.weights,
          "PLY with the importance of each Gaussian (comment l4d_weights 1). alpha_t, "
          "weight_sh, weight_scale, weight_rotor_spatial and weight_rotor_temporal are used as "
          "they are; without weight_sh, SH takes 0.6 alpha_t, and not weight_sh_gradient, which "
          "is zero where a colour is clamped, though that Gaussian occludes others")
      ->type_name("FILE");
  verb->add_option("--save-weights", arguments.save_weights,
                   "Also write the weights measured, for `--weights`")
      ->type_name("FILE");
  verb->add_flag(
      "--no-prune", arguments.no_prune,
      "Keep Gaussians that show in no view, and those that cost more bits than they show, "
      "whatever the preset says. With --cameras both are dropped otherwise, unless views were "
      "chosen by --frames or --ids or made up");
  verb->add_flag(
      "--estimate", arguments.estimate,
      "Estimate importance from sizes, opacities and lifetimes. Without it, a scene that "
      "comes without cameras and weights is looked at from 36 views that are made up");
}

void add_refit_option(Verb* verb, std::string& passes) {
  verb->add_option(
          "--refit", passes,
          "After pruning, fit the opacities of the Gaussians that stay so that renders match the "
          "scene's, in so many passes over views; prune and code as far as the fidelity aimed at "
          "allows, as renders show it. 0: prune by weights alone and render nothing. Default: 2, "
          "on a CUDA device 4, more or fewer by --effort, if that saves bytes; 0 where views were "
          "chosen by --frames or --ids "
          "or made up")
      ->type_name("PASSES")
      ->whole_number(0, 64);
}

}  // namespace

bool EncodeArguments::measures() const { return cameras.given() && weights.empty(); }

bool EncodeArguments::may_look_around() const {
  return !cameras.given() && weights.empty() && !estimate && !live.live && has_renderer();
}

bool EncodeArguments::has_all_views() const {
  return cameras.orbit == 0 && cameras.frames.empty() && cameras.ids.empty();
}

uint32_t EncodeArguments::weight_views() const {
  if (!measures()) return L4D_WEIGHT_VIEWS_UNKNOWN;
  return has_all_views() ? L4D_WEIGHT_VIEWS_ALL : L4D_WEIGHT_VIEWS_SOME;
}

bool EncodeArguments::has_pieces() const {
  std::error_code error;
  return inputs.size() > 1 || std::filesystem::is_directory(input, error);
}

std::string refit_obstacle(const EncodeArguments& arguments,
                           const std::optional<eval::Target>& target) {
  const EncodeParameters& parameters = arguments.parameters;
  if (!arguments.measures()) return "needs --cameras or --orbit, without --weights";
  if (target && target->kind == eval::Target::Kind::kMaxError) return "excludes --max-error";
  if (arguments.no_prune || !parameters.prune_weight.empty() ||
      parameters.sets(L4D_ENC_PRUNE_WEIGHT) || parameters.sets(L4D_ENC_PRUNE_COST)) {
    return "excludes --no-prune and other parameters of pruning";
  }
  if (arguments.measure.metric != MeasureArguments::kDefault) return "needs --metric gauss-newton";
  return "";
}

std::optional<eval::Target> check(Context& context, const EncodeArguments& arguments) {
  if (context.group().count() > 1 && arguments.input == "-") {
    throw usage_error("several ranks cannot share stdin");
  }
  const std::optional<eval::Target> target = parse_target(arguments.target, arguments.cameras);
  check_importance(arguments, target);
  if (target && (!arguments.parameters.quality.empty() || arguments.parameters.sets("quality"))) {
    throw usage_error("--quality excludes a target, which chooses the quality itself");
  }
  arguments.import.check();
  return target;
}

void check_live(Context& context, const EncodeArguments& arguments, bool has_target) {
  arguments.live.check();
  if (!arguments.live.live) {
    return;
  }
  if (arguments.sequence.given()) {
    throw usage_error("--live excludes --match and --sequence-error");
  }
  if (has_target || !arguments.order.empty() || arguments.verify ||
      !arguments.save_weights.empty()) {
    throw usage_error("--live excludes targets, --order, --verify and --save-weights");
  }
  // A piece lacks what lives on of those before it, so that its renders tell too little.
  if (!arguments.refit.empty() && arguments.has_pieces()) {
    throw usage_error("--refit is for one scene, not for pieces of one");
  }
  if (context.group().count() > 1) throw usage_error("--live is not for several ranks");
  if (!arguments.weights.empty() && arguments.has_pieces()) {
    throw usage_error("--weights is for one scene; --cameras measures each piece");
  }
  if (arguments.output.empty() && arguments.has_pieces() && arguments.inputs.size() == 1)
    throw usage_error("--output is needed for a folder");
}

void add_options(Verb* verb, EncodeArguments& arguments) {
  verb->add_option(
          "input", arguments.inputs,
          scene_help() +
              ". A PLY: l4d, 3DGS, FreeTimeGS, SpacetimeGaussians lite, Real-time-4DGS. A sequence "
              "of frames: several static scenes, a folder of them, or a pattern as frame_%04d.ply "
              "or "
              "'n/*/a.ply'. With --live: pieces of a scene, or a folder")
      ->required();
  verb->add_option("-o,--output", arguments.output,
                   "Stream to write, '-' = stdout (default: input's name with .l4d)")
      ->type_name("FILE");
  add_live_options(verb, arguments.live);
  arguments.cameras.add_options(verb, &arguments.import.seconds);
  arguments.measure.add_options(verb);
  add_weight_options(verb, arguments);
  add_refit_option(verb, arguments.refit);
  verb->add_option("--seed", arguments.seed, "Equal seeds give equal files on one machine")
      ->type_name("N")
      ->whole_number(0)
      ->capture_default_str();
  verb->add_option("--metadata", arguments.metadata, "KEY=VALUE to store; may be repeated")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  verb->add_option(
          "--rendering", arguments.rendering,
          "How the scene wants to be drawn, where that is not as in 3D Gaussian splatting: "
          "dilation=PIXELS^2, cutoff=SIGMAS, min_alpha=A, max_alpha=A, compensation=0|1, "
          "separated by commas. `render` and players obey it")
      ->type_name("NAME=VALUE,...");
  verb->add_option("--presentation", arguments.presentation,
                   "What a player does at first: playback=once|loop|ping-pong, bounds=X:Y:Z:X:Y:Z, "
                   "camera=X:Y:Z:X:Y:Z:X:Y:Z:DEGREES (position, target, up direction, vertical "
                   "field of view), metres_per_unit=M")
      ->type_name("NAME=VALUE,...");
  verb->add_flag("--no-first-view", arguments.no_first_view,
                 "State no first view where the scene has none: it saves about 100 bytes");
  verb->add_option("--order", arguments.order,
                   "Also write which input Gaussian each coded one is: u32 little-endian, for "
                   "`compare --order`")
      ->type_name("FILE");
  verb->add_flag("--verify", arguments.verify,
                 "Decode the result and print its errors, each Gaussian against its own input");
  arguments.parameters.add_options(verb);
  arguments.target.add_options(verb);
  add_import_options(verb, arguments.import, &arguments.cameras.cameras);
  add_sequence_input_options(verb, arguments.sequence);
  verb->footer(
      "Examples:\n"
      "  l4dcodec encode scene.ply -o scene.l4d\n"
      "  l4dcodec encode scene.ply --cameras cameras.json --preset large --verify\n"
      "  l4dcodec encode scene.ply --weights weights.ply --target-size 3MB\n"
      "  l4dcodec encode scene.ply --cameras cameras.json --target-fidelity 42dB\n"
      "  l4dcodec encode scene.ply --weights weights.ply --prune-weight 0\n"
      "  l4dcodec encode 'frame_%04d.ply' --fps 30 -o clip.l4d\n"
      "  l4dcodec encode --live pieces/ --playlist live.m3u8 -o live.l4d\n"
      "  l4dcodec encode scene.ply --preset indexed --codebook sh=8192 --stages all=1,0.5\n"
      "\n" +
      parameter_help());
}

}  // namespace l4d::cli
