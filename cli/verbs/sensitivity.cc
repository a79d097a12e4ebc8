// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <optional>

#include "cli/command/context.h"
#include "cli/command/progress.h"
#include "cli/input/camera_arguments.h"
#include "cli/input/files.h"
#include "cli/input/scene_source.h"
#include "cli/text/units.h"
#include "cli/verbs/importance.h"
#include "cli/verbs/verbs.h"

namespace l4d::cli {
namespace {

struct SensitivityArguments {
  std::string input;
  std::string output;
  CameraArguments cameras;
  MeasureArguments measure;
  ImportArguments import;
};

Importance measure(Context& context, const Input& input, const io::Scene& scene,
                   const SensitivityArguments& arguments) {
  const eval::CameraViews views =
      choose_views(context, arguments.cameras, "train", scene.timeline,
                   [&] { return eval::instant_of(scene, eval::middle_of(scene.timeline)); });
  return about(input.name(), [&] {
    return measure_importance(context, "sensitivity", scene, views, arguments.measure);
  });
}

// What a rank does for the one that writes the file.
void help_to_measure(Context& context, const Input& input, const SensitivityArguments& arguments) {
  const LoadedScene loaded = load_scene(context, input, arguments.import);
  measure(context, input, loaded.scene, arguments);
}

Outcome run_sensitivity(Context& context, const SensitivityArguments& arguments) {
  const Stopwatch watch;
  require_renderer("sensitivity");
  if (!arguments.cameras.given()) throw usage_error("sensitivity needs --cameras or --orbit");
  arguments.cameras.check();
  arguments.measure.check();  // a wrong one should not cost the time of reading
  check_one_file(arguments.output, "--output", {".ply"});
  arguments.import.check();
  context.files.add_input(arguments.input, kTheInput);
  arguments.cameras.load(context);
  std::optional<Output> written;
  if (!context.group().helps()) written.emplace(context, arguments.output);
  const Input input(context, arguments.input);
  if (context.group().count() > 1 && arguments.input == "-") {
    throw usage_error("several ranks cannot share stdin");
  }
  if (context.group().helps()) {
    help_to_measure(context, input, arguments);
    return {};
  }
  Output& output = *written;
  const LoadedScene loaded = load_scene(context, input, arguments.import);
  const io::Scene& scene = loaded.scene;
  const Importance importance = measure(context, input, scene, arguments);
  io::write_weights_ply(output.path(), importance.weights);
  const uint64_t bytes = output.finish();

  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  outcome.json = {{"schema", "l4dcodec.sensitivity/1"},
                  {"input", input.name()},
                  {"output", arguments.output},
                  {"num_gaussians", scene.count()},
                  {"metric", arguments.measure.metric}};
  outcome.json.update(importance.json());
  outcome.json["file_bytes"] = bytes;
  outcome.json["total_s"] = watch.seconds();
  outcome.text = format("%s: weights of %s Gaussians, %s\n", arguments.output.c_str(),
                        format_count(scene.count()).c_str(), format_bytes(bytes).c_str()) +
                 importance.text();
  return outcome;
}

}  // namespace

void add_sensitivity(Registry& registry) {
  auto arguments = std::make_shared<SensitivityArguments>();
  Verb* verb = add_verb(
      registry, "sensitivity", "Measure how much each Gaussian matters for images of the scene",
      [arguments](Context& context) { return run_sensitivity(context, *arguments); });
  verb->add_option("input", arguments->input, scene_help())->required();
  verb->add_option("-o,--output", arguments->output,
                   "Weights to write, for `encode --weights`; '-' = stdout")
      ->type_name("FILE")
      ->required();
  arguments->cameras.add_options(verb, &arguments->import.seconds);
  arguments->measure.add_options(verb);
  verb->add_option("--seed", arguments->measure.seed,
                   "Of the random signs of gauss-newton: equal seeds give equal weights")
      ->type_name("N")
      ->whole_number(0)
      ->capture_default_str()
      ->group("Importance from views");
  add_import_options(verb, arguments->import, &arguments->cameras.cameras);
  verb->footer(
      "Examples:\n"
      "  l4dcodec sensitivity scene.ply --cameras cameras.json -o weights.ply\n"
      "  l4dcodec sensitivity scene.ply --orbit 24 --frames 0:150:10 --all-views -o weights.ply\n"
      "Views are those of the training cameras where the file tells them apart, else all. Rows "
      "are\n"
      "in the order of the scene's Gaussians.");
}

}  // namespace l4d::cli
