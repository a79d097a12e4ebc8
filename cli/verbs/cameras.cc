// SPDX-License-Identifier: Apache-2.0

#include <memory>

#include "cli/command/context.h"
#include "cli/command/values.h"
#include "cli/input/camera_arguments.h"
#include "cli/input/files.h"
#include "cli/input/scene_source.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"
#include "eval/views/views.h"
#include "io/camera/first_view.h"
#include "io/camera/grid.h"
#include "io/camera/write_cameras.h"

namespace l4d::cli {
namespace {

struct CamerasArguments {
  std::string input;
  std::string output;
  std::string from;
  bool any_path = false;
  uint32_t orbit = 0;
  std::string grid;
  std::string spread = "0.25";
  std::string size;
  ImportArguments import;
};

struct Grid {
  uint32_t columns = 0, rows = 0;
  double spread = 0;
};

Grid grid_of(const CamerasArguments& arguments) {
  constexpr uint64_t kMost = 1000;
  Grid grid;
  const std::string& text = arguments.grid;
  const size_t cross = text.find('x');
  if (cross == std::string::npos) {
    throw usage_error("--grid: '" + text + "' is not columns x rows, as 5x3");
  }
  const uint64_t columns = parse_size(text.substr(0, cross), "--grid");
  const uint64_t rows = parse_size(text.substr(cross + 1), "--grid");
  if (columns < 1 || rows < 1 || columns > kMost || rows > kMost) {
    throw usage_error("--grid takes 1 to 1000 columns and rows");
  }
  grid.columns = static_cast<uint32_t>(columns);
  grid.rows = static_cast<uint32_t>(rows);
  grid.spread = parse_number(arguments.spread, "--spread");
  if (!(grid.spread > 0 && grid.spread <= 10)) throw usage_error("--spread takes up to 10");
  return grid;
}

void check(const CamerasArguments& arguments) {
  const int ways = (arguments.from.empty() ? 0 : 1) + (arguments.orbit > 0 ? 1 : 0) +
                   (arguments.grid.empty() ? 0 : 1);
  if (ways != 1) throw usage_error("cameras needs one of --from FILE, --orbit N and --grid CxR");
  if (arguments.from.empty() == arguments.input.empty()) {
    throw usage_error(arguments.from.empty()
                          ? "--orbit and --grid need the scene that cameras look at"
                          : "--from needs no scene");
  }
  uint32_t width, height;
  made_up_size(arguments.size, &width, &height);
  if (!arguments.size.empty() && !arguments.from.empty()) {
    throw usage_error("--size is for made-up cameras");
  }
  const ImportArguments& import = arguments.import;
  const bool has_import = !import.seconds.empty() || !import.fps.empty() || import.activated;
  if (has_import && !arguments.from.empty()) {
    throw usage_error("--seconds, --fps and --activated are for the scene of made-up cameras");
  }
  if (!arguments.grid.empty()) grid_of(arguments);
  arguments.import.check();
}

// Cameras around what the scene shows, some of which are for tests.
io::CameraSet make_cameras(Context& context, const CamerasArguments& arguments) {
  const Input input(context, arguments.input);
  const LoadedScene loaded = load_scene(context, input, arguments.import);
  const io::Scene& scene = loaded.scene;
  io::CameraSet set;
  if (arguments.orbit > 0) {
    set = about(input.name(), [&] {
      return make_orbit(context, eval::instant_of(scene, eval::middle_of(scene.timeline)),
                        arguments.orbit, arguments.size);
    });
    io::split_for_tests(set);
  } else {
    l4d_presentation view = scene.presentation;
    if (view.has_camera == 0) io::state_first_view(scene, &view, context.budget().holder());
    if (view.has_camera == 0) throw usage_error("--grid: no Gaussian of the scene is visible");
    uint32_t width, height;
    made_up_size(arguments.size, &width, &height);
    const Grid grid = grid_of(arguments);
    set = io::grid_cameras(view, grid.columns, grid.rows, grid.spread, width, height);
  }
  set.fps = frames_per_second(scene.timeline);
  set.frames = scene.timeline.num_frames;
  return set;
}

// What cameras.json has no key for.
void note_left_out(Context& context, const io::CameraSet& set) {
  size_t instants = 0, images = 0;
  for (const io::Camera& camera : set.cameras) {
    instants += camera.time ? 1U : 0U;
    images += camera.image.empty() ? 0U : 1U;
  }
  if (instants > 0) {
    context.note("cameras.json has no key for an instant, which cameras have: " +
                 format_count(instants));
  }
  if (images > 0) {
    context.note("cameras.json has no key for an image, which cameras have: " +
                 format_count(images));
  }
}

Outcome run_cameras(Context& context, const CamerasArguments& arguments) {
  check(arguments);
  check_one_file(arguments.output, "--output", {".json"});
  if (!arguments.input.empty()) context.files.add_input(arguments.input, kTheInput);
  io::CameraSet set;
  if (!arguments.from.empty()) {
    set = read_camera_file(context, arguments.from, arguments.any_path);
  }
  Output output(context, arguments.output, "--output", true);
  if (arguments.from.empty()) set = make_cameras(context, arguments);
  for (const std::string& note : set.notes) context.note(note);
  note_left_out(context, set);
  io::write_cameras(output.path(), set);
  const uint64_t bytes = output.finish();

  size_t tests = 0, training = 0;
  for (const io::Camera& camera : set.cameras) {
    tests += camera.split == "test" ? 1U : 0U;
    training += camera.split == "train" ? 1U : 0U;
  }
  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  outcome.json = {{"schema", "l4dcodec.cameras/1"},
                  {"output", arguments.output},
                  {"source", set.source},
                  {"cameras", set.cameras.size()},
                  {"training", training},
                  {"test", tests},
                  {"file_bytes", bytes}};
  outcome.text = arguments.output + ": " + format_items(set.cameras.size(), "camera");
  if (training + tests > 0) {
    outcome.text +=
        ", " + format_count(training) + " for training and " + format_count(tests) + " for tests";
  }
  outcome.text += "\n";
  return outcome;
}

}  // namespace

void add_cameras(Registry& registry) {
  auto arguments = std::make_shared<CamerasArguments>();
  Verb* verb =
      add_verb(registry, "cameras", "Write a file of cameras, for --cameras of other verbs",
               [arguments](Context& context) { return run_cameras(context, *arguments); });
  verb->add_option("input", arguments->input, scene_help("Scene that made-up cameras look at"));
  verb->add_option("-o,--output", arguments->output, "cameras.json to write, '-' = stdout")
      ->type_name("FILE")
      ->required();
  Option* from = verb->add_option("--from", arguments->from,
                                  std::string("Convert cameras: ") + io::kCameraFiles)
                     ->type_name("FILE");
  add_any_path_option(verb, arguments->any_path)->needs(from);
  verb->add_option("--orbit", arguments->orbit,
                   "N cameras around the scene; the first and every 8th after it are for tests")
      ->type_name("N")
      ->whole_number(1, 100000);
  Option* grid =
      verb->add_option("--grid", arguments->grid,
                       "Columns x rows of cameras around the first view, as rigs have them, all\n"
                       "looking at what it looks at; that in the middle is for tests")
          ->type_name("CxR");
  verb->add_option("--spread", arguments->spread,
                   "Width of the grid, in units of the distance to what it looks at")
      ->type_name("X")
      ->capture_default_str()
      ->needs(grid);
  verb->add_option("--size", arguments->size, "Image size of made-up cameras (default: 640x360)")
      ->type_name("WxH");
  add_import_options(verb, arguments->import);
  verb->footer(
      "Examples:\n"
      "  l4dcodec cameras scene.ply --orbit 24 -o cameras.json\n"
      "  l4dcodec cameras --from colmap/sparse/0 -o cameras.json");
}

}  // namespace l4d::cli
