// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <optional>

#include "cli/camera_arguments.h"
#include "cli/common.h"
#include "cli/comparison.h"
#include "cli/encode_parameters.h"
#include "cli/files.h"
#include "cli/importance.h"
#include "cli/pairing.h"
#include "cli/progress.h"
#include "cli/scene_source.h"
#include "cli/units.h"
#include "io/formats.h"

namespace l4d::cli {
namespace {

struct EncodeArguments {
  std::string input;
  std::string output;
  std::string weights;
  CameraArguments cameras;
  MeasureArguments measure;
  std::string save_weights;
  bool no_prune = false;
  std::string order;
  uint64_t seed = 0;
  bool verify = false;
  std::vector<std::string> metadata;
  EncodeParameters parameters;
  ImportArguments import;
};

// What can be told to be wrong about weights before anything is read.
void check_importance(const EncodeArguments& arguments) {
  const bool measures = arguments.cameras.given();
  arguments.cameras.check();
  arguments.measure.options();
  if (!measures && arguments.measure.given()) {
    throw usage_error("--agreement, --all-views, --max-share and --measure need --cameras");
  }
  if (!measures && !arguments.save_weights.empty()) {
    throw usage_error("--save-weights needs --cameras");
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

// Whether Gaussians that show in no view go. Not where only some views were chosen, or made up:
// what shows in others would go too. And a lossless stream is promised to hold everything. What the
// parameters say about it counts more.
void decide_pruning(Context& context, const EncodeArguments& arguments,
                    const EncoderHandle& encoder) {
  const CameraArguments& cameras = arguments.cameras;
  if (arguments.no_prune) {
    encoder.check(l4d_encoder_set(encoder.get(), L4D_ENC_PRUNE_WEIGHT, L4D_ALL_COMPONENTS, -1));
  }
  if (!cameras.given() || arguments.no_prune) return;
  const auto parameter = [&](l4d_encoder_parameter id) {
    double value = 0;
    encoder.check(l4d_encoder_get(encoder.get(), id, L4D_ALL_COMPONENTS, &value));
    return value;
  };
  if (parameter(L4D_ENC_PRUNE_WEIGHT) >= 0) return;
  const bool lossless = parameter(L4D_ENC_LOSSLESS) != 0;
  if (lossless || cameras.orbit > 0 || !cameras.frames.empty() || !cameras.ids.empty()) {
    context.note(std::string("what shows in no view is kept, since ") +
                 (lossless ? "the stream is to be lossless" : "these are not all views there are") +
                 "; --prune-weight 0 drops it");
    return;
  }
  encoder.check(l4d_encoder_set(encoder.get(), L4D_ENC_PRUNE_WEIGHT, L4D_ALL_COMPONENTS, 0));
}

Importance measure(Context& context, const EncodeArguments& arguments, const Input& input,
                   const io::Scene& scene) {
  const CameraViews views = choose_views(context, arguments.cameras, "train", scene.timeline, [&] {
    return instant_of(scene, middle_of(scene.timeline));
  });
  return about(input.name(), [&] {
    return measure_importance(context, "encode", scene, views, arguments.measure);
  });
}

std::vector<uint32_t> encoded_order(const EncoderHandle& encoder, uint64_t coded) {
  std::vector<uint32_t> order(static_cast<size_t>(coded));
  encoder.check(l4d_encoder_get_order(encoder.get(), order.data(), order.size()));
  return order;
}

// Decodes what was just written and holds it against the scene.
Comparison verify(Context& context, const io::Scene& scene, const std::string& path,
                  const std::vector<unsigned char>& memory, const std::vector<uint32_t>& order) {
  Progress progress(context, "verify");
  const l4d_decoder_options options = context.decoder_options();
  DecoderHandle decoder(&options);
  decoder.check(l4d_decoder_set_progress(decoder.get(), &Progress::callback, &progress));
  if (memory.empty()) {
    decoder.open_file(path);
  } else {
    decoder.open_memory(memory.data(), memory.size());
  }
  const LoadedScene decoded = decode_scene(decoder);
  return compare_scenes(scene, decoded, pair_by_order(scene, decoded.scene, order),
                        context.options.threads);
}

Outcome run_encode(Context& context, const EncodeArguments& arguments) {
  const Stopwatch watch;
  const Input input(arguments.input);
  const std::string name =
      arguments.output.empty() ? derived_name(arguments.input, ".l4d") : arguments.output;
  Output output(context, name, {&input});
  check_importance(arguments);
  std::optional<Output> order_output, weights_output;
  const auto open_side_output = [&](std::optional<Output>& file, const std::string& path,
                                    const char* option) {
    if (path.empty()) return;
    if (path == "-") throw usage_error(std::string(option) + " cannot go to stdout");
    file.emplace(context, path, std::vector<const Input*>{&input});
  };
  open_side_output(order_output, arguments.order, "--order");
  open_side_output(weights_output, arguments.save_weights, "--save-weights");

  // Parameters before the scene: a wrong one should not cost the time of reading.
  l4d_encoder_options options;
  l4d_encoder_options_init(&options);
  options.threads = context.options.threads;
  options.seed = arguments.seed;
  const EncoderHandle encoder(&options);
  arguments.parameters.apply(encoder);
  decide_pruning(context, arguments, encoder);
  for (const std::string& text : arguments.metadata) {
    const auto [key, value] = parse_assignment(text, "--metadata");
    about("--metadata " + key, [&, key = key, value = value] {
      encoder.check(l4d_encoder_add_metadata(encoder.get(), key.c_str(), value.c_str()));
    });
  }

  const LoadedScene loaded = load_scene(context, input, arguments.import);
  const io::Scene& scene = loaded.scene;
  const l4d_gaussians view = scene.view();
  about(input.name(), [&] {
    encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &scene.timeline, &scene.placement));
  });
  EncoderWeights weights;
  if (!arguments.weights.empty()) {
    weights.set(encoder, arguments.weights,
                about(arguments.weights, [&] { return io::read_weights_ply(arguments.weights); }),
                scene.count());
  }
  const double read_seconds = watch.seconds();
  std::optional<Importance> importance;
  if (arguments.cameras.given()) {
    importance = measure(context, arguments, input, scene);
    if (weights_output) {
      io::write_weights_ply(weights_output->path(), importance->weights);
      weights_output->finish();
    }
    weights.set(encoder, "measured weights", std::move(importance->weights), scene.count());
  }
  std::vector<unsigned char> memory;
  {
    Progress progress(context, "encode");
    encoder.check(l4d_encoder_set_progress(encoder.get(), &Progress::callback, &progress));
    about(input.name(), [&] {
      if (output.is_special()) {
        memory = encoder.encode();
      } else {
        encoder.check(l4d_encoder_encode_file(encoder.get(), output.path().c_str()));
      }
    });
    encoder.check(l4d_encoder_set_progress(encoder.get(), nullptr, nullptr));
  }
  if (output.is_special()) {
    io::OutputFile file(output.path());
    file.write(memory.data(), memory.size());
    file.commit();
  }
  l4d_encode_report report;
  l4d_encode_report_init(&report);
  encoder.check(l4d_encoder_get_report(encoder.get(), &report));
  std::vector<uint32_t> order;
  if (order_output || arguments.verify) order = encoded_order(encoder, report.coded_gaussians);
  if (order_output) write_order(order_output->path(), order);
  const double total_seconds = watch.seconds();

  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  const double ratio =
      static_cast<double>(report.raw_bytes) / std::max(1.0, static_cast<double>(report.file_bytes));
  const double bits = 8 * static_cast<double>(report.file_bytes) /
                      std::max(1.0, static_cast<double>(report.coded_gaussians));
  Json stages = {{"read", read_seconds}};
  if (importance) stages["sensitivity"] = importance->seconds;
  for (uint32_t s = 0; s < report.num_stages; ++s) {
    const char* stage = nullptr;
    double seconds = 0;
    encoder.check(l4d_encoder_get_stage(encoder.get(), s, &stage, &seconds));
    stages[stage] = seconds + stages.value(stage, 0.0);
  }
  outcome.json = {{"schema", "l4dcodec.encode/1"},
                  {"input", input.name()},
                  {"source", scene.source},
                  {"output", name},
                  {"preset", arguments.parameters.preset},
                  {"input_gaussians", report.input_gaussians},
                  {"coded_gaussians", report.coded_gaussians},
                  {"invalid_dropped", report.invalid_dropped},
                  {"pruned", report.pruned},
                  {"moved_to_coarser", report.moved_to_coarser},
                  {"num_layers", report.num_layers},
                  {"raw_bytes", report.raw_bytes},
                  {"file_bytes", report.file_bytes},
                  {"ratio", ratio},
                  {"bits_per_gaussian", bits},
                  {"stages", stages},
                  {"total_s", total_seconds}};
  outcome.text =
      format("%s: %s Gaussians, %s, %.2f:1, %.1f bits per Gaussian, in %s\n", name.c_str(),
             format_count(report.coded_gaussians).c_str(), format_bytes(report.file_bytes).c_str(),
             ratio, bits, format_seconds(total_seconds).c_str());
  if (importance) {
    outcome.json["sensitivity"] = importance->json();
    outcome.text += importance->text();
  }
  const uint64_t left_out = report.input_gaussians - report.coded_gaussians;
  if (left_out > 0) {
    outcome.text +=
        format("left out %s of %s: %s invalid, %s pruned\n", format_count(left_out).c_str(),
               format_count(report.input_gaussians).c_str(),
               format_count(report.invalid_dropped).c_str(), format_count(report.pruned).c_str());
  }
  if (arguments.verify) {
    const Stopwatch verify_watch;
    const Comparison comparison = verify(context, scene, output.path(), memory, order);
    outcome.json["verify"] = comparison.json();
    outcome.json["verify"]["total_s"] = verify_watch.seconds();
    outcome.text += "\nverified against the input: " + comparison.text();
  }
  output.finish();
  if (order_output) order_output->finish();
  return outcome;
}

}  // namespace

void add_encode(Registry& registry) {
  auto arguments = std::make_shared<EncodeArguments>();
  CLI::App* verb = add_verb(registry, "encode", "Encode a scene", [arguments](Context& context) {
    return run_encode(context, *arguments);
  });
  verb->add_option(
          "input", arguments->input,
          "Scene: PLY (l4d, 3DGS, FreeTimeGS, SpacetimeGaussians lite) or .l4d, '-' = stdin")
      ->required();
  verb->add_option("-o,--output", arguments->output,
                   "Stream to write, '-' = stdout (default: input's name with .l4d)")
      ->type_name("FILE");
  arguments->cameras.add_options(verb);
  arguments->measure.add_options(verb);
  verb->add_option(
          "--weights", arguments->weights,
          "PLY with the importance of each Gaussian (comment l4d_weights 1). alpha_t, "
          "weight_sh, weight_scale, weight_rotor_spatial and weight_rotor_temporal are used as "
          "they are; without weight_sh, SH takes 0.6 alpha_t, and not weight_sh_gradient, which "
          "is zero where a colour is clamped, though that Gaussian occludes others. Without "
          "weights: a proxy of opacity, area and lifetime")
      ->type_name("FILE")
      ->excludes(verb->get_option("--cameras"))
      ->excludes(verb->get_option("--orbit"));
  verb->add_option("--save-weights", arguments->save_weights,
                   "Also write the weights measured, for `--weights`")
      ->type_name("FILE");
  verb->add_flag(
      "--no-prune", arguments->no_prune,
      "Keep Gaussians that show in no view, whatever the preset says. With --cameras they "
      "are dropped otherwise, unless views were chosen by --frames or --ids or made up");
  verb->add_option("--seed", arguments->seed, "Equal seeds give equal files on one machine")
      ->type_name("N")
      ->capture_default_str();
  verb->add_option("--metadata", arguments->metadata, "KEY=VALUE to store; may be repeated")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  verb->add_option("--order", arguments->order,
                   "Also write which input Gaussian each coded one is: u32 little-endian, for "
                   "`compare --order`")
      ->type_name("FILE");
  verb->add_flag("--verify", arguments->verify,
                 "Decode the result and print its errors, each Gaussian against its own input");
  arguments->parameters.add_options(verb);
  add_import_options(verb, arguments->import);
  verb->footer(
      "Examples:\n"
      "  l4dcodec encode scene.ply -o scene.l4d\n"
      "  l4dcodec encode scene.ply --cameras cameras.json --preset high --verify\n"
      "  l4dcodec encode scene.ply --weights weights.ply --prune-weight 0\n"
      "  l4dcodec encode scene.ply --codebook sh=8192 --stages all=1,0.5 --set page-size=4Ki\n"
      "\n" +
      parameter_help());
}

}  // namespace l4d::cli
