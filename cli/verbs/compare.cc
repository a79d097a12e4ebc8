// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <optional>
#include <utility>

#include "cli/command/context.h"
#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/camera_arguments.h"
#include "cli/input/files.h"
#include "cli/input/scene_source.h"
#include "cli/text/units.h"
#include "cli/verbs/compare_renders.h"
#include "cli/verbs/comparison_text.h"
#include "cli/verbs/verbs.h"
#include "eval/pair/pairing.h"
#include "eval/pair/seen_errors.h"
#include "eval/views/min_sizes.h"

namespace l4d::cli {
namespace {

// Of error maps: an error of 1/8 of the range is the brightest.
constexpr double kErrorGain = 8;

struct CompareArguments {
  std::string a, b;
  std::string order;
  bool exact = false;
  std::vector<std::string> max_error;
  bool attributes = false;
  CameraArguments cameras;
  bool images = false;
  bool per_view = false;
  std::string side_by_side;
  std::string error_gain;
  std::string min_fidelity;
  std::string lpips;
  bool jod = false;
  std::string display, min_jod;
  ImportArguments import;

  // Pairing the Gaussians of two scenes takes longer than rendering them.
  bool wants_attributes() const {
    return !cameras.given() || attributes || exact || !max_error.empty() || !order.empty();
  }
};

bool same_timeline(const l4d_timeline& a, const l4d_timeline& b) {
  return a.time_begin == b.time_begin && a.num_frames == b.num_frames &&
         uint64_t{a.fps_num} * b.fps_den == uint64_t{b.fps_num} * a.fps_den;
}

// What a comparison has to say, and the demands on it that do not hold.
struct Verdict {
  Outcome outcome;
  Json not_met = Json::array();

  void demand(bool met, const std::string& what) {
    if (met) return;
    outcome.code = kExitNo;
    not_met.push_back(what);
    outcome.text += "not met: " + what + "\n";
  }
};

void note_timelines(Context& context, const l4d_timeline& a, const l4d_timeline& b) {
  if (same_timeline(a, b)) return;
  context.note("the timelines differ: A has " + describe_timeline(a) + ", B has " +
               describe_timeline(b));
}

void begin(Verdict& verdict, const Input& a, uint64_t count_a, const Input& b, uint64_t count_b,
           bool same_time) {
  verdict.outcome.json = {{"schema", "l4dcodec.compare/1"},
                          {"a", a.name()},
                          {"b", b.name()},
                          {"num_gaussians_a", count_a},
                          {"num_gaussians_b", count_b},
                          {"timeline_equal", same_time}};
  verdict.outcome.text = "A " + a.name() + ", " + format_items(count_a, "Gaussian") + "\nB " +
                         b.name() + ", " + format_items(count_b, "Gaussian") + "\n";
}

// Pairs by the file of --order; one that does not fit is a wrong argument.
eval::Pairing pair_as_told(const io::Scene& a, const io::Scene& b,
                           const std::vector<uint32_t>& order, const std::string& path) {
  try {
    return eval::pair_by_order(a, b, order);
  } catch (const io::Error& error) {
    if (error.status() != L4D_ERR_INVALID_ARGUMENT) throw;
    throw usage_error(path + ": " + error.what());
  }
}

// Errors have the unit of a Gaussian's size, of which a stream states the least that it counts.
// Where most of a scene is left out, or where a stream lies, that least size may exceed what A asks
// for.
void note_sizes(Context& context, const Input& b, double stated, double own) {
  if (stated <= 2 * own) return;
  context.note(b.name() + " counts sizes below " + format_number(stated) + " as that, which is " +
               format_number(stated / own) +
               " times what A asks for: errors in sizes are as many times smaller");
}

void compare_attributes(Context& context, const CompareArguments& arguments,
                        const std::vector<ErrorBound>& bounds, const Input& input_a,
                        const Input& input_b, Verdict& verdict) {
  std::vector<uint32_t> order;
  if (!arguments.order.empty()) order = eval::read_order(arguments.order);
  const LoadedScene a = load_scene(context, input_a, arguments.import);
  const LoadedScene b = load_scene(context, input_b, arguments.import);
  const bool same_time = same_timeline(a.scene.timeline, b.scene.timeline);
  note_timelines(context, a.scene.timeline, b.scene.timeline);
  const eval::Comparison comparison = [&] {
    Progress progress(context, "compare");
    progress.step("matching");
    const uint32_t threads = context.options.threads;
    const LoadedScene* stream_a = input_a.is_scene() ? nullptr : &a;
    std::vector<float> sizes;
    if (const io::CameraSet* cameras = arguments.cameras.load(context)) {
      sizes = eval::min_sizes(a.scene, *cameras, threads);
    }
    eval::Pairing pairing =
        arguments.order.empty()
            ? eval::pair_by_content(a.scene, b, threads, sizes, stream_a, progress)
            : pair_as_told(a.scene, b.scene, order, arguments.order);
    progress.step("comparing");
    return eval::compare_scenes(a.scene, b, std::move(pairing), threads, sizes, stream_a);
  }();
  check_interrupt();
  note_sizes(context, input_b, comparison.min_size, eval::min_size(a.scene));
  begin(verdict, input_a, a.scene.count(), input_b, b.scene.count(), same_time);
  verdict.outcome.json.update(comparison_json(comparison));
  verdict.outcome.text += comparison_text(comparison);
  if (arguments.exact) {
    verdict.demand(comparison.identical() && same_time, "the scenes are identical");
  }
  if (!bounds.empty() && !comparison.pairing.is_known()) {
    throw usage_error(std::string("--max-error: which Gaussian of ") + input_b.name() +
                      " is which of " + input_a.name() + " is not known. " + kHowToPair);
  }
  for (const ErrorBound& bound : bounds) {
    // Negated, so that an error that is no number fails.
    const bool met =
        comparison.pairing.matched > 0 && comparison.max_error(bound.name) <= bound.limit;
    verdict.demand(met, "max error of " + bound.name + " <= " + format_number(bound.limit));
  }
}

void compare_views(Context& context, const CompareArguments& arguments, const Input& input_a,
                   const Input& input_b, const RenderOptions& options, Verdict& verdict) {
  const RendersCompared compared = compare_renders(
      context, input_a, input_b, arguments.import, arguments.cameras, options,
      [&](const Side& a, const Side& b) {
        if (arguments.wants_attributes()) return;
        note_timelines(context, a.timeline, b.timeline);
        begin(verdict, input_a, a.count, input_b, b.count, same_timeline(a.timeline, b.timeline));
      });
  verdict.outcome.json.update(compared.json);
  verdict.outcome.text += compared.text;
  if (!arguments.min_fidelity.empty()) {
    const double least = parse_decibels(arguments.min_fidelity, "--min-fidelity");
    verdict.demand(compared.fidelity_db >= least, "fidelity >= " + format_number(least) + " dB");
  }
  if (!arguments.min_jod.empty()) {
    const double least = parse_number(arguments.min_jod, "--min-jod");
    verdict.demand(compared.min_jod >= least, "JOD of every camera >= " + format_number(least));
  }
}

// Null where JOD is not asked for.
const eval::JodDisplay* display_of(const CompareArguments& arguments) {
  const bool wanted = arguments.jod || !arguments.min_jod.empty();
  if (!wanted && !arguments.display.empty()) throw usage_error("--display needs --jod");
  if (!arguments.min_jod.empty()) parse_number(arguments.min_jod, "--min-jod");
  if (!wanted) return nullptr;
  return parse_display(arguments.display);
}

// Usage errors that need no file.
double check_image_options(const CompareArguments& arguments) {
  arguments.cameras.check();
  const bool uses_images = arguments.images || arguments.per_view || arguments.attributes ||
                           !arguments.side_by_side.empty() || !arguments.error_gain.empty() ||
                           !arguments.min_fidelity.empty() || !arguments.lpips.empty() ||
                           arguments.jod || !arguments.min_jod.empty();
  if (uses_images && !arguments.cameras.given()) {
    throw usage_error(
        "--images, --per-view, --side-by-side, --error-gain, --min-fidelity, --lpips, --jod, "
        "--min-jod and --attributes need --cameras");
  }
  if (arguments.images && arguments.cameras.orbit > 0) {
    throw usage_error("--images: made-up cameras have seen nothing");
  }
  if (!arguments.min_fidelity.empty()) parse_decibels(arguments.min_fidelity, "--min-fidelity");
  if (arguments.error_gain.empty()) return kErrorGain;
  if (arguments.side_by_side.empty()) throw usage_error("--error-gain needs --side-by-side");
  const double gain = parse_number(arguments.error_gain, "--error-gain");
  if (!(gain > 0)) throw usage_error("--error-gain must be positive");
  return gain;
}

Outcome run_compare(Context& context, const CompareArguments& arguments) {
  const Stopwatch watch;
  std::vector<ErrorBound> bounds;
  for (const std::string& text : arguments.max_error) bounds.push_back(parse_error_bound(text));
  if (arguments.a == "-" && arguments.b == "-") throw usage_error("only one input can be stdin");
  const double gain = check_image_options(arguments);
  const eval::JodDisplay* display = display_of(arguments);
  arguments.import.check();
  context.files.add_input(arguments.a, "A");
  context.files.add_input(arguments.b, "B");
  if (!arguments.order.empty()) context.files.add_input(arguments.order, "--order");
  if (!arguments.lpips.empty()) context.files.add_input(arguments.lpips, "--lpips");
  arguments.cameras.load(context);
  std::optional<Output> picture;
  if (!arguments.side_by_side.empty()) {
    check_extension(arguments.side_by_side, "--side-by-side", {".png"}, true);
    picture.emplace(context, arguments.side_by_side, "--side-by-side");
    if (picture->is_stdout()) throw usage_error("--side-by-side cannot go to stdout");
  }
  std::optional<eval::Lpips> lpips;
  std::shared_ptr<void> network;
  if (!arguments.lpips.empty()) {
    io::InputFile file(arguments.lpips);
    // As it is stored, and as it is used.
    network = context.budget().take(2 * file.size(), "the network of --lpips");
    lpips = eval::Lpips::read(std::move(file), context.budget().holder());
  }
  const Input input_a(context, arguments.a, "A");
  const Input input_b(context, arguments.b, "B");
  Verdict verdict;
  if (arguments.wants_attributes()) {
    compare_attributes(context, arguments, bounds, input_a, input_b, verdict);
  }
  if (arguments.cameras.given()) {
    const RenderOptions options = {
        arguments.images, arguments.per_view,           gain, lpips ? &*lpips : nullptr,
        display,          picture ? &*picture : nullptr};
    compare_views(context, arguments, input_a, input_b, options, verdict);
  }
  verdict.outcome.json["not_met"] = verdict.not_met;
  verdict.outcome.json["total_s"] = watch.seconds();
  return std::move(verdict.outcome);
}

}  // namespace

void add_compare(Registry& registry) {
  auto arguments = std::make_shared<CompareArguments>();
  Verb* verb =
      add_verb(registry, "compare", "Measure how far scene B is from A: attributes, or images",
               [arguments](Context& context) { return run_compare(context, *arguments); });
  verb->add_option("a", arguments->a, scene_help("Reference"))->required();
  verb->add_option("b", arguments->b, scene_help("Scene to measure"))->required();
  verb->add_option("--order", arguments->order,
                   "Pairs told by `encode --order FILE`: A is what was encoded, B the stream")
      ->type_name("FILE");
  verb->add_flag("--exact", arguments->exact,
                 "Exit with 1 unless both hold the same Gaussians bit for bit, in any order");
  verb->add_option("--max-error", arguments->max_error,
                   "NAME=VALUE: exit with 1 if the maximum is larger; NAME is an attribute or "
                   "visible_position. May be repeated")
      ->type_name("NAME=V")
      ->allow_extra_args(false);
  arguments->cameras.add_options(verb, &arguments->import.seconds);
  const std::string group = "Comparing images, with --cameras or --orbit";
  verb->add_flag("--images", arguments->images,
                 "Also compare both with what the cameras saw: the videos (through ffmpeg) or "
                 "images that the camera file names")
      ->group(group);
  verb->add_flag("--per-view", arguments->per_view, "List every view")->group(group);
  verb->add_option("--side-by-side", arguments->side_by_side,
                   "PNG of the worst view: A, B, and a map of their difference")
      ->type_name("FILE")
      ->group(group);
  verb->add_option("--error-gain", arguments->error_gain,
                   "Factor of the differences in that map (default: 8)")
      ->type_name("G")
      ->group(group);
  verb->add_option("--min-fidelity", arguments->min_fidelity,
                   "Exit with 1 if B's images are less than DB decibels from A's")
      ->type_name("DB")
      ->group(group);
  verb->add_option("--lpips", arguments->lpips,
                   "Also measure LPIPS, with the weights of AlexNet or VGG16 in this .safetensors "
                   "file (training/README.md)")
      ->type_name("FILE")
      ->group(group);
  verb->add_flag("--jod", arguments->jod,
                 "Also measure JOD (ColorVideoVDP) of the videos that cameras make: 10 = no "
                 "difference")
      ->group(group);
  verb->add_option("--display", arguments->display,
                   "Where videos are looked at, for --jod: standard_4k (default), standard_fhd")
      ->type_name("NAME")
      ->group(group);
  verb->add_option("--min-jod", arguments->min_jod,
                   "Exit with 1 if the JOD of B against A is less in any camera; measures it")
      ->type_name("J")
      ->group(group);
  verb->add_flag("--attributes", arguments->attributes,
                 "Also compare attributes, which pairs Gaussians and takes longer")
      ->group(group);
  add_import_options(verb, arguments->import, &arguments->cameras.cameras);
  verb->footer(
      "With --cameras, renders of both are compared: views of the test cameras where the file "
      "tells\n"
      "them apart, else all. Fidelity is the PSNR of the mean squared error over all views, at "
      "most\n"
      "100 dB, which stands for equal images.\n"
      "  l4dcodec compare scene.ply scene.l4d --cameras cameras.json --frames 0:150:10 --images\n"
      "\n"
      "How Gaussians are paired, since coding reorders them:\n"
      "  order    with --order: exact, whatever coding did\n"
      "  exact    every row of one is in the other, bit for bit\n"
      "  stated   else, if B is a stream: one to one, so that no pair differs by more than B "
      "states\n"
      "           of itself, nearest pairs first. Where Gaussians are so alike that either may be\n"
      "           what the other became, they may be swapped.\n"
      "  unknown  if there are no such pairs, or B states nothing: single Gaussians are not\n"
      "           compared, and --max-error is refused.\n"
      "visible_position: distance between both at 5 instants from the first to the last at which\n"
      "A's Gaussian is visible (within 4 standard deviations of its mean time and the sequence).");
}

}  // namespace l4d::cli
