// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>

#include "cli/camera_arguments.h"
#include "cli/common.h"
#include "cli/files.h"
#include "cli/frame_files.h"
#include "cli/rendering.h"
#include "cli/scene_source.h"
#include "cli/text/comparison_text.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"
#include "cli/verbs/encode_live.h"
#include "cli/verbs/encode_parameters.h"
#include "cli/verbs/importance.h"
#include "cli/verbs/refit.h"
#include "cli/verbs/target.h"
#include "eval/encoding.h"
#include "eval/min_sizes.h"
#include "eval/pairing.h"
#include "io/camera/first_view.h"
#include "io/ply/weights.h"
#include "io/scene/rendering_text.h"

namespace l4d::cli {
namespace {

struct EncodeArguments {
  std::vector<std::string> inputs;
  std::string input;                // the first of them
  std::vector<std::string> frames;  // of a sequence, else empty
  SequenceInputArguments sequence;
  std::string output;
  std::string weights;
  CameraArguments cameras;
  MeasureArguments measure;
  std::string save_weights;
  bool no_prune = false;
  bool estimate = false;
  std::string refit;  // "" = where the views are all there are
  std::string order;
  uint64_t seed = 0;
  bool verify = false;
  std::vector<std::string> metadata;
  std::string rendering, presentation;
  bool no_first_view = false;
  EncodeParameters parameters;
  TargetArguments target;
  ImportArguments import;
  LiveArguments live;

  // With weights of a file, cameras say only how small a Gaussian can look, and serve a target.
  bool measures() const { return cameras.given() && weights.empty(); }
  // Whether views are made up for a scene that comes without cameras. The pieces of a recording
  // that grows are not waited for, and all have importance of one kind.
  bool may_look_around() const {
    return !cameras.given() && weights.empty() && !estimate && !live.live && has_renderer();
  }
  // Whether the views are all that the scene is made for.
  bool has_all_views() const {
    return cameras.orbit == 0 && cameras.frames.empty() && cameras.ids.empty();
  }
  uint32_t weight_views() const {
    if (!measures()) return L4D_WEIGHT_VIEWS_UNKNOWN;
    return has_all_views() ? L4D_WEIGHT_VIEWS_ALL : L4D_WEIGHT_VIEWS_SOME;
  }
  // Of --live: more than one scene that is there.
  bool has_pieces() const {
    std::error_code error;
    return inputs.size() > 1 || std::filesystem::is_directory(input, error);
  }
};

// Why opacities are not fitted with these options; "" = they can be.
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

// Tells the encoder which Gaussians to keep, and people which it keeps because of the views.
void tell_pruning(Context& context, const EncodeArguments& arguments,
                  const EncoderHandle& encoder) {
  if (arguments.no_prune) {
    encoder.set(L4D_ENC_PRUNE_WEIGHT, -1);
    encoder.set(L4D_ENC_PRUNE_COST, 0);
  }
  if (!arguments.measures()) return;
  const bool all = arguments.has_all_views();
  if (arguments.no_prune || eval::get_parameter(encoder, L4D_ENC_PRUNE_WEIGHT) >= 0) return;
  const bool lossless = eval::get_parameter(encoder, L4D_ENC_LOSSLESS) != 0;
  if (all && !lossless) return;
  context.note(std::string("what shows in no view is kept, since ") +
               (lossless ? "the stream is to be lossless" : "these are not all views there are") +
               "; --prune-weight 0 drops it");
}

// The views that importance is measured from, and how.
struct Measuring {
  eval::CameraViews views;
  MeasureArguments how;
  bool made_up = false;    // for a scene that comes without cameras
  bool fits_long = false;  // a refit in these views, which nobody asked for, takes long

  // Views that the arguments ask for.
  Measuring(Context& context, const EncodeArguments& arguments, const io::Scene& scene)
      : views(
            choose_views(context, arguments.cameras, "train", scene.timeline,
                         [&] { return eval::instant_of(scene, eval::middle_of(scene.timeline)); })),
        how(how_of(arguments)) {}
  Measuring(const EncodeArguments& arguments, eval::CameraViews made_up_views)
      : views(std::move(made_up_views)), how(how_of(arguments)), made_up(true) {
    how.all_views = true;
    how.alone = true;  // they are few
  }

 private:
  static MeasureArguments how_of(const EncodeArguments& arguments) {
    MeasureArguments how = arguments.measure;
    how.seed = arguments.seed;
    // The thresholds of these presets are in units of sums.
    if (arguments.parameters.preset.rfind("paper-", 0) == 0) how.metric = "sum";
    return how;
  }
};

Importance measure(Context& context, const Input& input, const io::Scene& scene,
                   const Measuring& measuring) {
  Importance importance = about(input.name(), [&] {
    return measure_importance(context, "encode", scene, measuring.views, measuring.how);
  });
  importance.made_up = measuring.made_up;
  if (importance.report.unseen == scene.count()) {
    throw Failure(L4D_ERR_INVALID_SCENE, "the cameras show nothing of " + input.name());
  }
  return importance;
}

// Importance from views that are made up; none where they show nothing or there is no memory for
// them, since the user did not ask for any.
std::optional<Importance> look_around(Context& context, const EncodeArguments& arguments,
                                      const Input& input, const io::Scene& scene) {
  const auto may_be_left_out = [](const std::string& status) {
    return status == l4d_status_name(L4D_ERR_INVALID_SCENE) ||
           status == l4d_status_name(L4D_ERR_LIMIT_EXCEEDED);
  };
  try {
    const Measuring measuring = about(input.name(), [&] {
      return Measuring(arguments, eval::made_up_views(scene, context.budget().holder()));
    });
    return measure(context, input, scene, measuring);
  } catch (const Failure& failure) {
    if (!may_be_left_out(failure.name())) throw;
    context.note(std::string("importance is estimated, without views that are made up: ") +
                 failure.what());
    return std::nullopt;
  }
}

void write_stream(const std::string& path, const std::vector<unsigned char>& stream) {
  io::OutputFile file(path);
  file.write(stream.data(), stream.size());
  file.commit();
}

void add_report(const l4d_encode_report& report, const std::string& name, double total_seconds,
                Outcome* outcome) {
  const double ratio =
      static_cast<double>(report.raw_bytes) / std::max(1.0, static_cast<double>(report.file_bytes));
  const double bits = 8 * static_cast<double>(report.file_bytes) /
                      std::max(1.0, static_cast<double>(report.coded_gaussians));
  outcome->json.update({{"input_gaussians", report.input_gaussians},
                        {"coded_gaussians", report.coded_gaussians},
                        {"invalid_dropped", report.invalid_dropped},
                        {"pruned", report.pruned},
                        {"moved_to_coarser", report.moved_to_coarser},
                        {"num_layers", report.num_layers},
                        {"escapes", report.escapes},
                        {"raw_bytes", report.raw_bytes},
                        {"file_bytes", report.file_bytes},
                        {"ratio", ratio},
                        {"bits_per_gaussian", bits},
                        {"total_s", total_seconds}});
  outcome->text +=
      format("%s: %s Gaussians, %s, %.2f:1, %.1f bits per Gaussian, in %s\n", name.c_str(),
             format_count(report.coded_gaussians).c_str(), format_bytes(report.file_bytes).c_str(),
             ratio, bits, format_seconds(total_seconds).c_str());
  outcome->json["max_errors"] = {{"position_sizes", report.max_position_error},
                                 {"covariance_factor", report.max_covariance_factor},
                                 {"seen_opacity", report.max_opacity_error},
                                 {"visible_position", report.max_visible_error},
                                 {"mean_t_sigmas", report.max_mean_t_error},
                                 {"base_color", report.max_base_color_error},
                                 {"directional_color", report.max_directional_color_error}};
  outcome->text += format(
      "of single Gaussians at most: position %.3g of their size, variances by a factor of %.3g, "
      "opacity %.3g, mean time %.3g standard deviations, base colour %.3g, directional %.3g; %s "
      "stored as they are\n",
      report.max_position_error, report.max_covariance_factor, report.max_opacity_error,
      report.max_mean_t_error, report.max_base_color_error, report.max_directional_color_error,
      format_count(report.escapes).c_str());
  const uint64_t left_out = report.input_gaussians - report.coded_gaussians;
  if (left_out == 0) return;
  outcome->text +=
      format("left out %s of %s: %s invalid, %s pruned\n", format_count(left_out).c_str(),
             format_count(report.input_gaussians).c_str(),
             format_count(report.invalid_dropped).c_str(), format_count(report.pruned).c_str());
}

// A decoder of the stream that was written.
DecoderHandle open_written(const eval::Encoding& encoding, const Output& output) {
  DecoderHandle decoder;
  if (encoding.stream.empty()) {
    decoder.open_file(output.path());
  } else {
    decoder.open_memory(encoding.stream.data(), encoding.stream.size());
  }
  return decoder;
}

// Usage errors that need no file, and the target.
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

void register_inputs(Context& context, const EncodeArguments& arguments) {
  if (arguments.frames.empty()) context.files.add_input(arguments.input, kTheInput);
  if (!arguments.weights.empty()) context.files.add_input(arguments.weights, "--weights");
  arguments.cameras.load(context);
}

// Changes what the scene states of itself to what the options say.
void change_statements(const EncodeArguments& arguments, l4d_rendering* rendering,
                       l4d_presentation* presentation) {
  const auto parse = [](const char* option, const std::string& text, const auto& change) {
    if (text.empty()) return;
    try {
      change();
    } catch (const io::Error& error) {
      throw usage_error(std::string(option) + ": " + error.what());
    }
  };
  parse("--rendering", arguments.rendering,
        [&] { io::parse_rendering(arguments.rendering, rendering); });
  parse("--presentation", arguments.presentation,
        [&] { io::parse_presentation(arguments.presentation, presentation); });
}

// States where a player stands at first, unless the scene or an option says so: as in the piece
// before, if there is one.
void state_first_view(Context& context, const EncodeArguments& arguments,
                      const l4d_presentation* before, io::Scene* scene) {
  l4d_presentation& p = scene->presentation;
  if (arguments.no_first_view || p.has_camera != 0 || scene->count() == 0) return;
  if (before != nullptr && before->has_camera != 0) {
    io::copy_first_view(*before, &p);
    return;
  }
  // Cameras that are made up say nothing of what there is to see.
  const io::CameraSet* cameras = arguments.cameras.load(context);
  const io::Hold holder = context.budget().holder();
  if (cameras != nullptr) io::state_first_view(*cameras, *scene, &p, holder);
  if (p.has_camera == 0) io::state_first_view(*scene, &p, holder);
}

// The scene, with what the options state of it. before: what the piece before states.
LoadedScene load(Context& context, const EncodeArguments& arguments, const Input& input,
                 bool may_be_empty = false, const l4d_presentation* before = nullptr) {
  ImportArguments import = arguments.import;
  import.may_be_empty = may_be_empty;
  LoadedScene loaded = arguments.frames.empty()
                           ? load_scene(context, input, import)
                           : load_frames(context, arguments.frames, import, arguments.sequence);
  change_statements(arguments, &loaded.scene.rendering, &loaded.scene.presentation);
  state_first_view(context, arguments, before, &loaded.scene);
  return loaded;
}

// The files that a command writes.
struct Outputs {
  std::string name;
  Output stream;
  std::optional<Output> order, weights;

  Outputs(Context& context, const EncodeArguments& arguments)
      : name(arguments.output.empty() ? derived_name(arguments.input, ".l4d") : arguments.output),
        stream(context, checked(name)) {
    if (!arguments.save_weights.empty()) {
      check_extension(arguments.save_weights, "--save-weights", {".ply"});
    }
    open(context, order, arguments.order, "--order");
    open(context, weights, arguments.save_weights, "--save-weights");
  }

 private:
  static const std::string& checked(const std::string& name) {
    check_extension(name, "--output", {".l4d"});
    return name;
  }
  static void open(Context& context, std::optional<Output>& file, const std::string& path,
                   const char* option) {
    if (path.empty()) return;
    file.emplace(context, path, option);
    if (file->is_stdout()) throw usage_error(std::string(option) + " cannot go to stdout");
  }
};

EncoderHandle make_encoder(const Context& context, const EncodeArguments& arguments) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.threads = context.options.threads;
  options.backend = context.backend();
  options.seed = arguments.seed;
  return EncoderHandle(&options);
}

// The preset, what was set, and what is pruned.
void set_coding(Context& context, const EncodeArguments& arguments, const EncoderHandle& encoder) {
  arguments.parameters.apply(context, encoder);
  tell_pruning(context, arguments, encoder);
}

void set_parameters(Context& context, const EncodeArguments& arguments, bool has_target,
                    const EncoderHandle& encoder) {
  set_coding(context, arguments, encoder);
  if (has_target) arguments.parameters.require_quality(encoder, "a target");
  l4d_rendering rendering = default_rendering();
  l4d_presentation presentation = default_presentation();
  change_statements(arguments, &rendering, &presentation);
  std::set<std::string> keys;
  for (const std::string& text : arguments.metadata) {
    const auto [key, value] = parse_assignment(text, "--metadata");
    if (!keys.insert(key).second) throw usage_error("--metadata: '" + key + "' is given twice");
    about("--metadata " + key, [&, key = key, value = value] {
      encoder.check(l4d_encoder_add_metadata(encoder.get(), key.c_str(), value.c_str()));
    });
  }
}

// Passes of the fit of opacities, 0 = none: by default where the encoder would otherwise drop
// Gaussians by what they cost.
uint32_t refit_passes(const EncodeArguments& arguments, const std::optional<eval::Target>& target,
                      uint32_t backend, const EncoderHandle& encoder) {
  if (arguments.refit == "0" || !refit_obstacle(arguments, target).empty()) return 0;
  const bool can = eval::can_refit(encoder);
  if (arguments.refit.empty()) {
    if (!can || !arguments.has_all_views()) return 0;
    return eval::refit_defaults(backend, eval::get_parameter(encoder, L4D_ENC_EFFORT)).passes;
  }
  if (!can) {
    throw usage_error("--refit: the preset '" + arguments.parameters.preset +
                      "' with what is set prunes nothing by a quality");
  }
  return static_cast<uint32_t>(parse_size(arguments.refit, "--refit"));
}

constexpr const char* kMeasuredWeights = "measured weights";

// Gives the encoder the weights of a file or of views. Returns what was measured.
std::optional<Importance> set_weights(Context& context, const EncodeArguments& arguments,
                                      const Input& input, const io::Scene& scene,
                                      const EncoderHandle& encoder,
                                      const std::optional<Measuring>& measuring,
                                      std::optional<Output>& saved, EncoderImportance& told) {
  const auto tell = [&](const std::string& name, io::Weights weights, uint32_t views) {
    told.set_weights(name, std::move(weights), views, scene.count());
    about(name, [&] { told.tell(encoder); });
  };
  if (!arguments.weights.empty()) {
    tell(arguments.weights,
         about(arguments.weights,
               [&] { return io::read_weights_ply(arguments.weights, context.budget().holder()); }),
         L4D_WEIGHT_VIEWS_UNKNOWN);
  }
  std::optional<Importance> importance;
  if (measuring) {
    importance = measure(context, input, scene, *measuring);
  } else if (arguments.may_look_around() && eval::has_quality(encoder)) {
    importance = look_around(context, arguments, input, scene);
  }
  if (!importance) return std::nullopt;
  if (saved) {
    io::write_weights_ply(saved->path(), importance->weights);
    saved->finish();
  }
  tell(kMeasuredWeights, std::move(importance->weights),
       importance->made_up ? uint32_t{L4D_WEIGHT_VIEWS_SOME} : arguments.weight_views());
  return importance;
}

// passes: of a refit, 0 = none.
std::optional<Measuring> choose_measuring(Context& context, const EncodeArguments& arguments,
                                          const io::Scene& scene, uint32_t passes) {
  std::optional<Measuring> measuring;
  if (!arguments.measures()) return measuring;
  measuring.emplace(context, arguments, scene);
  if (passes == 0) return measuring;
  const eval::RefitDefaults defaults = eval::refit_defaults(context.backend());
  measuring->fits_long = arguments.refit.empty() && context.backend() != L4D_BACKEND_CUDA &&
                         eval::is_long_fit(measuring->views, defaults.fit_views, scene.count());
  if (!measuring->fits_long && !arguments.measure.given()) {
    measuring->how.most_views = defaults.views_before;
  }
  return measuring;
}

// What a rank does for the one that writes the file.
void help_to_measure(Context& context, const EncodeArguments& arguments, uint32_t passes) {
  const Input input(context, arguments.input);
  if (!arguments.measures()) return;
  const LoadedScene loaded = load(context, arguments, input);
  measure(context, input, loaded.scene,
          *choose_measuring(context, arguments, loaded.scene, passes));
}

// path: "" = into memory.
eval::Encoding encode_once(Context& context, const EncoderHandle& encoder, const Input& input,
                           const std::string& path, bool wants_order) {
  Progress progress(context, "encode");
  try {
    return eval::encode_scene(progress, encoder, path, wants_order, context.budget().holder());
  } catch (const Error& error) {
    // What fails about files is about the output, which the message names.
    throw current_failure(error.status() == L4D_ERR_IO ? "" : input.name());
  }
}

// What a command did, and how long that took.
struct Encoded {
  const eval::Encoding& encoding;
  const std::optional<Importance>& importance;
  const std::optional<eval::Refit>& refit;
  const std::optional<TargetReached>& reached;
  double quality, read_seconds, total_seconds;
};

Outcome describe(const EncodeArguments& arguments, const Input& input, const io::Scene& scene,
                 const EncoderHandle& encoder, const std::string& name, const Encoded& encoded) {
  Outcome outcome;
  outcome.json = {{"schema", "l4dcodec.encode/1"},
                  {"input", input.name()},
                  {"source", scene.source},
                  {"output", name},
                  {"preset", arguments.parameters.preset}};
  add_report(encoded.encoding.report, name, encoded.total_seconds, &outcome);
  const auto& [encoding, importance, refit, reached, quality, read_seconds, total_seconds] =
      encoded;
  Json& stages = outcome.json["steps"] = {{"read", read_seconds}};
  if (importance) stages["sensitivity"] = importance->seconds;
  if (refit) stages["refit"] = refit->seconds;
  if (reached) stages["search"] = reached->seconds;
  for (const auto& [stage, seconds] : encoding.stages) stages[stage] = seconds;
  if (eval::has_quality(encoder)) {
    outcome.json["quality"] = reached ? reached->search.result().quality : quality;
  }
  if (reached) {
    outcome.json["target"] = reached->json();
    outcome.text += reached->text();
    if (!reached->search.result().met) outcome.code = kExitNo;
  }
  if (importance) {
    outcome.json["sensitivity"] = importance->json();
    outcome.json["sensitivity"]["made_up"] = importance->made_up;
    outcome.text += importance->text();
  }
  if (refit) describe_refit(*refit, &outcome);
  return outcome;
}

void add_verification(Context& context, const io::Scene& scene, const std::string& path,
                      const std::vector<float>& min_sizes, const eval::Encoding& encoding,
                      Outcome* outcome) {
  const Stopwatch watch;
  Progress progress(context, "verify");
  const eval::Comparison comparison =
      eval::compare_encoding(decoding_of(context, min_sizes), progress, scene, path, encoding);
  outcome->json["verify"] = comparison_json(comparison);
  outcome->json["verify"]["total_s"] = watch.seconds();
  outcome->text += "\nverified against the input: " + comparison_text(comparison);
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

// Gives the encoder a scene and what the cameras say of it. told: borrowed by the encoder.
void set_scene(Context& context, const EncodeArguments& arguments, const io::Scene& scene,
               const EncoderHandle& encoder, EncoderImportance* told) {
  const l4d_gaussians view = scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &scene.timeline, &scene.placement));
  encoder.check(l4d_encoder_set_rendering(encoder.get(), &scene.rendering));
  encoder.check(l4d_encoder_set_presentation(encoder.get(), &scene.presentation));
  // Cameras that are made up say nothing of where the scene will be seen from.
  if (const io::CameraSet* cameras = arguments.cameras.load(context)) {
    if (!told->has_min_sizes()) {
      told->set_min_sizes(eval::min_sizes(scene, *cameras, context.options.threads));
    }
    told->tell(encoder);
  }
}

// aim: the fidelity that the coded scene is to have; 0: what follows from that of weights alone.
// search: encodes to a target, if there is one; *reached is of the encoding that is returned.
eval::Refit encode_refitted(Context& context, const EncodeArguments& arguments, const Input& input,
                            const io::Scene& scene, const EncoderHandle& encoder,
                            const Measuring& measuring, uint32_t passes, double aim,
                            EncoderImportance& told,
                            const std::function<TargetReached(eval::Encoding*)>& search,
                            std::optional<TargetReached>* reached) {
  std::optional<Progress> progress;
  std::optional<TargetReached> fitted;
  eval::RefitCalls calls;
  calls.begin = [&](const std::string& label) -> eval::Observer& {
    progress.reset();
    return progress.emplace(context, "encode", label);
  };
  calls.holder = context.budget().holder();
  calls.encode_plain = [&] {
    progress.reset();
    if (!search) return encode_once(context, encoder, input, "", true);
    eval::Encoding encoding;
    *reached = search(&encoding);
    return encoding;
  };
  if (search) {
    calls.encode_fitted = [&]() -> std::optional<eval::Encoding> {
      progress.reset();
      eval::Encoding encoding;
      fitted = search(&encoding);
      const auto met = [](const TargetReached& of) { return of.search.result().met; };
      if (met(**reached) && !met(*fitted)) return std::nullopt;
      return encoding;
    };
  }
  calls.measure = [&](const io::Scene& part) {
    progress.reset();
    MeasureArguments how = measuring.how;
    how.alone = true;  // other ranks have no part to measure
    if (how.most_views > 0) {
      how.most_views = eval::refit_defaults(context.backend()).views_after;
      how.visibility = "none";  // what stays stays
    }
    return measure_importance(context, "encode", part, measuring.views, how).weights;
  };
  calls.set_weights = [&](const io::Weights& weights) {
    told.set_weights(kMeasuredWeights, weights, arguments.weight_views(), scene.count());
    about(kMeasuredWeights, [&] { told.tell(encoder); });
  };
  eval::RefitInput in{scene, told.weights(), measuring.views, rendering_of(context, "fast", 2)};
  in.fidelity = aim;
  in.passes = passes;
  in.fit_views = eval::refit_defaults(context.backend()).fit_views;
  in.max_render_bytes = context.render_memory(in.max_render_bytes);
  in.drop_unseen = arguments.has_all_views();
  in.always = !arguments.refit.empty();  // the user asks for the fit: it stays, whatever it saves
  in.only_if_missed = measuring.fits_long;
  in.preset = arguments.parameters.preset;
  in.is_set = [&](const char* name) { return arguments.parameters.sets(name); };
  eval::Refit refit = about(input.name(), [&] { return eval::refit(in, encoder, calls); });
  progress.reset();
  note_refit(context, refit);
  if (refit.is_kept && fitted) *reached = std::move(fitted);
  return refit;
}

Outcome run_live(Context& context, const EncodeArguments& arguments) {
  if (!arguments.weights.empty()) context.files.add_input(arguments.weights, "--weights");
  arguments.cameras.load(context);
  const std::string name =
      arguments.output.empty() ? derived_name(arguments.input, ".l4d") : arguments.output;
  check_extension(name, "--output", {".l4d"});
  const EncoderHandle encoder = make_encoder(context, arguments);
  set_parameters(context, arguments, false, encoder);
  const uint32_t passes =
      arguments.has_pieces() ? 0 : refit_passes(arguments, {}, context.backend(), encoder);
  std::optional<eval::Refit> refit;
  l4d_presentation shown = default_presentation();
  const auto read = [&](const Input& piece, const std::function<void(const io::Scene&)>& use) {
    const LoadedScene loaded = load(context, arguments, piece, arguments.has_pieces(), &shown);
    if (loaded.scene.count() > 0) shown = loaded.scene.presentation;
    if (loaded.scene.count() == 0) {
      encoder.check(l4d_encoder_set_rendering(encoder.get(), &loaded.scene.rendering));
      encoder.check(l4d_encoder_set_presentation(encoder.get(), &loaded.scene.presentation));
      return use(loaded.scene);
    }
    EncoderImportance told;
    about(piece.name(), [&] { set_scene(context, arguments, loaded.scene, encoder, &told); });
    std::optional<Output> unused;
    const std::optional<Measuring> measuring =
        choose_measuring(context, arguments, loaded.scene, passes);
    set_weights(context, arguments, piece, loaded.scene, encoder, measuring, unused, told);
    if (passes > 0) {
      const io::Weights measured = told.weights();
      refit = encode_refitted(context, arguments, piece, loaded.scene, encoder, *measuring, passes,
                              eval::get_parameter(encoder, L4D_ENC_QUALITY), told, {}, nullptr);
      refit->encoding = {};
      if (!refit->is_kept) {
        set_coding(context, arguments, encoder);
        encoder.check(l4d_encoder_set_fitted_opacity(encoder.get(), nullptr));
        told.set_weights(kMeasuredWeights, measured, arguments.weight_views(), measured.count);
        told.tell(encoder);
      }
    }
    use(loaded.scene);
  };
  Outcome outcome = encode_live(context, arguments.live, arguments.inputs, name, {encoder, read});
  outcome.json["preset"] = arguments.parameters.preset;
  if (refit) describe_refit(*refit, &outcome);
  return outcome;
}

// The files of a sequence, if the inputs name one.
void find_frames(Context& context, EncodeArguments* arguments) {
  constexpr const char* kNeedsOutput = "--output is needed for a sequence of frames";
  if (arguments->inputs.size() > 1 && arguments->output.empty()) throw usage_error(kNeedsOutput);
  arguments->frames = frame_files(context, arguments->inputs);
  if (arguments->frames.empty()) {
    if (!arguments->sequence.given()) return;
    throw usage_error("--match and --sequence-error need a sequence of frames");
  }
  if (arguments->output.empty()) throw usage_error(kNeedsOutput);
  arguments->input = arguments->frames.front();
}

Outcome run_encode(Context& context, EncodeArguments& arguments) {
  const Stopwatch watch;
  const std::optional<eval::Target> target = check(context, arguments);
  check_live(context, arguments, target.has_value());
  if (arguments.live.live) return run_live(context, arguments);
  find_frames(context, &arguments);
  register_inputs(context, arguments);
  // Parameters before the scene: a wrong one should not cost the time of reading.
  const EncoderHandle encoder = make_encoder(context, arguments);
  set_parameters(context, arguments, target.has_value(), encoder);
  const uint32_t passes = refit_passes(arguments, target, context.backend(), encoder);
  if (context.group().helps()) {
    help_to_measure(context, arguments, passes);
    return {};
  }
  Outputs outputs(context, arguments);
  const Input input(context, arguments.input);
  const LoadedScene loaded = load(context, arguments, input);
  const io::Scene& scene = loaded.scene;
  EncoderImportance told;
  about(input.name(), [&] { set_scene(context, arguments, scene, encoder, &told); });
  const double read_seconds = watch.seconds();
  const std::optional<Measuring> measuring = choose_measuring(context, arguments, scene, passes);
  const std::optional<Importance> importance =
      set_weights(context, arguments, input, scene, encoder, measuring, outputs.weights, told);
  eval::Encoding encoding;
  std::optional<TargetReached> reached;
  std::optional<eval::Refit> refit;
  const bool wants_order = outputs.order || arguments.verify;
  const double quality =
      eval::has_quality(encoder) ? eval::get_parameter(encoder, L4D_ENC_QUALITY) : 0;
  std::function<TargetReached(eval::Encoding*)> search;
  if (target) {
    search = [&](eval::Encoding* to) {
      return about(input.name(), [&] {
        return encode_to_target(context, *target, encoder, input.name(), scene, arguments.cameras,
                                told.min_sizes(), to);
      });
    };
  }
  if (passes > 0) {
    const double aim = !target                                         ? quality
                       : target->kind == eval::Target::Kind::kFidelity ? target->requested
                                                                       : 0;
    refit = encode_refitted(context, arguments, input, scene, encoder, *measuring, passes, aim,
                            told, search, &reached);
    encoding = std::move(refit->encoding);
  } else if (target) {
    reached = search(&encoding);
  } else {
    // Into memory where the output is not to be renamed over.
    encoding = encode_once(context, encoder, input,
                           outputs.stream.is_special() ? "" : outputs.stream.path(), wants_order);
  }
  if (!encoding.stream.empty()) write_stream(outputs.stream.path(), encoding.stream);
  arguments.parameters.note_unused(context, open_written(encoding, outputs.stream));
  if (outputs.order) eval::write_order(outputs.order->path(), encoding.order);
  Outcome outcome =
      describe(arguments, input, scene, encoder, outputs.name,
               {encoding, importance, refit, reached, quality, read_seconds, watch.seconds()});
  outcome.stdout_is_data = outputs.stream.is_stdout();
  if (arguments.verify) {
    add_verification(context, scene, outputs.stream.path(), told.min_sizes(), encoding, &outcome);
  }
  outputs.stream.finish();
  if (outputs.order) outputs.order->finish();
  return outcome;
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

void add_encode(Registry& registry) {
  auto arguments = std::make_shared<EncodeArguments>();
  Verb* verb = add_verb(registry, "encode", "Encode a scene", [arguments](Context& context) {
    arguments->input = arguments->inputs.front();
    return run_encode(context, *arguments);
  });
  verb->add_option(
          "input", arguments->inputs,
          scene_help() +
              ". A PLY: l4d, 3DGS, FreeTimeGS, SpacetimeGaussians lite, Real-time-4DGS. A sequence "
              "of frames: several static scenes, a folder of them, or a name with a %d as "
              "frame_%04d.ply. With --live: pieces of a scene, or a folder")
      ->required();
  verb->add_option("-o,--output", arguments->output,
                   "Stream to write, '-' = stdout (default: input's name with .l4d)")
      ->type_name("FILE");
  add_live_options(verb, arguments->live);
  arguments->cameras.add_options(verb, &arguments->import.seconds);
  arguments->measure.add_options(verb);
  add_weight_options(verb, *arguments);
  add_refit_option(verb, arguments->refit);
  verb->add_option("--seed", arguments->seed, "Equal seeds give equal files on one machine")
      ->type_name("N")
      ->whole_number(0)
      ->capture_default_str();
  verb->add_option("--metadata", arguments->metadata, "KEY=VALUE to store; may be repeated")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  verb->add_option(
          "--rendering", arguments->rendering,
          "How the scene wants to be drawn, where that is not as in 3D Gaussian splatting: "
          "dilation=PIXELS^2, cutoff=SIGMAS, min_alpha=A, max_alpha=A, compensation=0|1, "
          "separated by commas. `render` and players obey it")
      ->type_name("NAME=VALUE,...");
  verb->add_option("--presentation", arguments->presentation,
                   "What a player does at first: playback=once|loop|ping-pong, bounds=X:Y:Z:X:Y:Z, "
                   "camera=X:Y:Z:X:Y:Z:X:Y:Z:DEGREES (position, target, up direction, vertical "
                   "field of view), metres_per_unit=M")
      ->type_name("NAME=VALUE,...");
  verb->add_flag("--no-first-view", arguments->no_first_view,
                 "State no first view where the scene has none: it saves about 100 bytes");
  verb->add_option("--order", arguments->order,
                   "Also write which input Gaussian each coded one is: u32 little-endian, for "
                   "`compare --order`")
      ->type_name("FILE");
  verb->add_flag("--verify", arguments->verify,
                 "Decode the result and print its errors, each Gaussian against its own input");
  arguments->parameters.add_options(verb);
  arguments->target.add_options(verb);
  add_import_options(verb, arguments->import, &arguments->cameras.cameras);
  add_sequence_input_options(verb, arguments->sequence);
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
