// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>

#include "cli/common.h"
#include "cli/comparison.h"
#include "cli/files.h"
#include "cli/pairing.h"
#include "cli/progress.h"
#include "cli/scene_source.h"
#include "cli/units.h"

namespace l4d::cli {
namespace {

struct CompareArguments {
  std::string a, b;
  std::string order;
  bool exact = false;
  std::vector<std::string> max_error;
  ImportArguments import;
};

struct Bound {
  std::string name;
  double limit;
};

std::vector<Bound> parse_bounds(const std::vector<std::string>& texts) {
  std::vector<Bound> bounds;
  for (const std::string& text : texts) {
    const auto [name, value] = parse_assignment(text, "--max-error");
    bounds.push_back({name, parse_number(value, "--max-error " + name)});
  }
  return bounds;
}

double error_of(const Comparison& comparison, const std::string& name) {
  if (name == "visible_position") return comparison.visible.max;
  for (const AttributeError& e : comparison.attributes) {
    if (name == e.name) return e.max;
  }
  std::string names = "visible_position";
  for (const AttributeError& e : comparison.attributes) names += std::string(", ") + e.name;
  throw usage_error("--max-error: '" + name + "' is none of " + names);
}

bool same_timeline(const l4d_timeline& a, const l4d_timeline& b) {
  return a.time_begin == b.time_begin && a.num_frames == b.num_frames &&
         uint64_t{a.fps_num} * b.fps_den == uint64_t{b.fps_num} * a.fps_den;
}

Outcome run_compare(Context& context, const CompareArguments& arguments) {
  const Stopwatch watch;
  const std::vector<Bound> bounds = parse_bounds(arguments.max_error);
  if (arguments.a == "-" && arguments.b == "-") throw usage_error("only one input can be stdin");
  const Input input_a(arguments.a);
  const Input input_b(arguments.b);
  std::vector<uint32_t> order;
  if (!arguments.order.empty()) order = read_order(arguments.order);
  const LoadedScene a = load_scene(context, input_a, arguments.import);
  const LoadedScene b = load_scene(context, input_b, arguments.import);
  const bool same_time = same_timeline(a.scene.timeline, b.scene.timeline);
  if (!same_time) {
    context.note("the timelines differ: A has " + describe_timeline(a.scene.timeline) + ", B has " +
                 describe_timeline(b.scene.timeline));
  }
  Comparison comparison;
  {
    Progress progress(context, "compare");
    progress.step("matching");
    Pairing pairing =
        arguments.order.empty()
            ? pair_by_content(a.scene, b.scene, context.options.threads)
            : about(arguments.order, [&] { return pair_by_order(a.scene, b.scene, order); });
    progress.step("comparing");
    comparison = compare_scenes(a.scene, b, std::move(pairing), context.options.threads);
  }
  check_interrupt();

  Outcome outcome;
  outcome.json = {{"schema", "l4dcodec.compare/1"},
                  {"a", input_a.name()},
                  {"b", input_b.name()},
                  {"num_gaussians_a", a.scene.count()},
                  {"num_gaussians_b", b.scene.count()},
                  {"timeline_equal", same_time}};
  outcome.json.update(comparison.json());
  outcome.text = "A " + input_a.name() + ", " + format_count(a.scene.count()) + " Gaussians\nB " +
                 input_b.name() + ", " + format_count(b.scene.count()) + " Gaussians\n" +
                 comparison.text();
  Json failed = Json::array();
  const auto demand = [&](bool met, const std::string& what) {
    if (met) return;
    outcome.code = kExitNo;
    failed.push_back(what);
    outcome.text += "not met: " + what + "\n";
  };
  if (arguments.exact) {
    demand(comparison.identical() && same_time, "the scenes are identical");
  }
  for (const Bound& bound : bounds) {
    // Negated, so that an error that is no number fails.
    const bool met =
        comparison.pairing.matched > 0 && error_of(comparison, bound.name) <= bound.limit;
    demand(met, "max error of " + bound.name + " <= " + format_number(bound.limit));
  }
  outcome.json["not_met"] = failed;
  outcome.json["total_s"] = watch.seconds();
  return outcome;
}

}  // namespace

void add_compare(Registry& registry) {
  auto arguments = std::make_shared<CompareArguments>();
  CLI::App* verb =
      add_verb(registry, "compare", "Measure how far scene B's attributes are from A's",
               [arguments](Context& context) { return run_compare(context, *arguments); });
  verb->add_option("a", arguments->a, "Reference: .l4d or PLY, '-' = stdin")->required();
  verb->add_option("b", arguments->b, "Scene to measure: .l4d or PLY, '-' = stdin")->required();
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
  add_import_options(verb, arguments->import);
  verb->footer(
      "How Gaussians are paired, since coding reorders them:\n"
      "  order    with --order: exact, whatever coding did\n"
      "  exact    every row of one is in the other, bit for bit\n"
      "  nearest  else: equal rows first, then one to one by the smallest distance in position at\n"
      "           the middle of the visible span (in units of the scene's spread) with smaller\n"
      "           weights for time and length of that span, opacity, size and colour. A guess:\n"
      "           twins in a dense place may be swapped, which hardly changes the figures of\n"
      "           position, but may those of the rest. Use --order for exact figures.\n"
      "visible_position: distance between both at 5 instants from the first to the last at which\n"
      "A's Gaussian is visible (within 4 standard deviations of its mean time and the sequence).");
}

}  // namespace l4d::cli
