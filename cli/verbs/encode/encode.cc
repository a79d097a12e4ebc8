// SPDX-License-Identifier: Apache-2.0
#include <functional>
#include <memory>
#include <optional>
#include <set>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/files.h"
#include "cli/verbs/encode/refit.h"
#include "cli/verbs/encode/report.h"
#include "cli/verbs/encode/scene.h"
#include "cli/verbs/encode/weights.h"
#include "cli/verbs/verbs.h"
#include "eval/target/encoding.h"

namespace l4d::cli {
namespace {

// Tells the encoder which Gaussians to keep, and people which it keeps because of the views.
void tell_pruning(Context& context, const EncodeArguments& arguments,
                  const EncoderHandle& encoder) {
  if (arguments.no_prune) {
    encoder.set(L4D_ENC_PRUNE_WEIGHT, -1);
    encoder.set(L4D_ENC_PRUNE_COST, 0);
  }
  if (!arguments.measures()) return;
  const bool all = arguments.has_all_views();
  if (arguments.no_prune || encoder.value(L4D_ENC_PRUNE_WEIGHT) >= 0) return;
  const bool lossless = encoder.value(L4D_ENC_LOSSLESS) != 0;
  if (all && !lossless) return;
  context.note(std::string("what shows in no view is kept, since ") +
               (lossless ? "the stream is to be lossless" : "these are not all views there are") +
               "; --prune-weight 0 drops it");
}

void write_stream(const std::string& path, const std::vector<unsigned char>& stream) {
  io::OutputFile file(path);
  file.write(stream.data(), stream.size());
  file.commit();
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

void register_inputs(Context& context, const EncodeArguments& arguments) {
  if (arguments.frames.empty()) context.files.add_input(arguments.input, kTheInput);
  if (!arguments.weights.empty()) context.files.add_input(arguments.weights, "--weights");
  arguments.cameras.load(context);
}

// The files that a command writes.
struct Outputs {
  std::string name;
  Output stream;
  std::optional<Output> order, weights;

  Outputs(Context& context, const EncodeArguments& arguments)
      : name(output_name(arguments.output, arguments.input, ".l4d")), stream(context, name) {
    if (!arguments.save_weights.empty()) {
      check_extension(arguments.save_weights, "--save-weights", {".ply"});
    }
    open(context, order, arguments.order, "--order");
    open(context, weights, arguments.save_weights, "--save-weights");
  }

 private:
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

// What a rank does for the one that writes the file.
void help_to_measure(Context& context, const EncodeArguments& arguments, uint32_t passes) {
  const Input input(context, arguments.input);
  if (!arguments.measures()) return;
  const LoadedScene loaded = load(context, arguments, input);
  measure(context, input, loaded.scene,
          *choose_measuring(context, arguments, loaded.scene, passes));
}

Outcome run_live(Context& context, const EncodeArguments& arguments) {
  if (!arguments.weights.empty()) context.files.add_input(arguments.weights, "--weights");
  arguments.cameras.load(context);
  const std::string name = output_name(arguments.output, arguments.input, ".l4d");
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
                              encoder.value(L4D_ENC_QUALITY), told, {}, nullptr);
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
  const double quality = eval::has_quality(encoder) ? encoder.value(L4D_ENC_QUALITY) : 0;
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
  if (reached) reached->note(context);
  if (arguments.verify) {
    add_verification(context, scene, outputs.stream.path(), told.min_sizes(), encoding, &outcome);
  }
  outputs.stream.finish();
  if (outputs.order) outputs.order->finish();
  return outcome;
}

}  // namespace

void add_encode(Registry& registry) {
  auto arguments = std::make_shared<EncodeArguments>();
  Verb* verb = add_verb(registry, "encode", "Encode a scene", [arguments](Context& context) {
    arguments->input = arguments->inputs.front();
    return run_encode(context, *arguments);
  });
  add_options(verb, *arguments);
}

}  // namespace l4d::cli
