// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/comparison_text.h"

#include "cli/command/context.h"
#include "cli/command/values.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

Json visible_json(const eval::VisibleError& e) {
  return {{"gaussians", e.gaussians}, {"max", e.max}, {"p999", e.p999}, {"rmse", e.rmse}};
}

}  // namespace

ErrorBound parse_error_bound(const std::string& text) {
  const auto [name, value] = parse_assignment(text, "--max-error");
  const double limit = parse_number(value, "--max-error " + name);
  std::string names;
  bool known = false;
  for (const std::string& each : eval::error_names()) {
    known = known || name == each;
    names += (names.empty() ? "" : ", ") + each;
  }
  if (!known) throw usage_error("--max-error: '" + name + "' is none of " + names);
  if (limit < 0) throw usage_error("--max-error " + name + " must not be negative");
  return {name, limit};
}

Json comparison_json(const eval::Comparison& c) {
  const uint64_t unmatched_a = c.count_a - c.pairing.matched;
  const uint64_t unmatched_b = c.count_b - c.pairing.matched;
  Json j = {{"identical", c.identical()},        {"match", c.pairing.match},
            {"matched", c.pairing.matched},      {"unmatched", unmatched_a + unmatched_b},
            {"unmatched_a", unmatched_a},        {"unmatched_b", unmatched_b},
            {"equal_rows", c.pairing.equal_rows}};
  if (!c.pairing.is_known()) return j;
  j["attributes"] = Json::object();
  for (const eval::AttributeError& e : c.attributes) {
    j["attributes"][e.name] = {{"max", e.max}, {"rmse", e.rmse}};
  }
  j["seen"] = {{"min_size", c.min_size}};
  for (const eval::SeenError& e : c.seen) {
    j["seen"][e.name] = {{"max", e.max}, {"p999", e.p999}, {"worst", e.worst}};
  }
  Json& v = j["visible_position"] = visible_json(c.visible);
  v["samples_per_gaussian"] = eval::kSamples;
  v["layers"] = Json::array();
  for (const eval::VisibleError& layer : c.layers) {
    Json entry = {{"index", layer.layer}, {"level", layer.level}};
    entry.update(visible_json(layer));
    v["layers"].push_back(entry);
  }
  return j;
}

std::string comparison_text(const eval::Comparison& c) {
  if (!c.pairing.is_known()) {
    return format_count(c.pairing.equal_rows) +
           " Gaussians are equal bit for bit\nsingle Gaussians are not compared: which is which is "
           "not known. " +
           kHowToPair + "\n";
  }
  const char* how = c.pairing.match == "order"   ? "by the encoder's order"
                    : c.pairing.match == "exact" ? "by equal bits"
                                                 : "within the errors that B states";
  std::string t = format("%s Gaussians matched %s", format_count(c.pairing.matched).c_str(), how);
  if (c.count_a > c.pairing.matched)
    t += ", " + format_count(c.count_a - c.pairing.matched) + " of A alone";
  if (c.count_b > c.pairing.matched)
    t += ", " + format_count(c.count_b - c.pairing.matched) + " of B alone";
  t += c.identical() ? "; identical\n" : "\n";
  t += format("\n%-12s %10s %10s\n", "attribute", "max", "rmse");
  for (const eval::AttributeError& e : c.attributes) {
    t += format("%-12s %10s %10s  %s\n", e.name, format_error(e.max).c_str(),
                format_error(e.rmse).c_str(), e.meaning);
  }
  t += format("\nof single Gaussians, on their own scale; sizes below %s count as that\n",
              format_error(c.min_size).c_str());
  t += format("%-18s %10s %10s %12s\n", "error", "max", "p99.9", "worst of A");
  for (const eval::SeenError& e : c.seen) {
    t += format("%-18s %10s %10s %12u  %s\n", e.name, format_error(e.max).c_str(),
                format_error(e.p999).c_str(), e.worst, e.meaning);
  }
  t += "\nposition error while visible, in scene units\n";
  t += format("%-6s %-6s %12s %10s %10s %10s\n", "layer", "level", "gaussians", "max", "p99.9",
              "rmse");
  const auto row = [&](const std::string& layer, const std::string& level,
                       const eval::VisibleError& e) {
    t += format("%-6s %-6s %12s %10s %10s %10s\n", layer.c_str(), level.c_str(),
                format_count(e.gaussians).c_str(), format_error(e.max).c_str(),
                format_error(e.p999).c_str(), format_error(e.rmse).c_str());
  };
  for (const eval::VisibleError& l : c.layers)
    row(std::to_string(l.layer), std::to_string(l.level), l);
  row("all", "", c.visible);
  return t;
}

const eval::JodDisplay* parse_display(const std::string& name) {
  const eval::JodDisplay* display = eval::find_jod_display(name.empty() ? "standard_4k" : name);
  if (display == nullptr) {
    throw usage_error("--display is " + name + "; it must be standard_4k or standard_fhd");
  }
  return display;
}

}  // namespace l4d::cli
