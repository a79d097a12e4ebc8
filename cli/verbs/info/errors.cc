// SPDX-License-Identifier: Apache-2.0
#include "cli/text/units.h"
#include "cli/verbs/info/parts.h"
#include "l4d/experimental/inspect.hpp"

namespace l4d::cli {
namespace {

// What the encoder states of single Gaussians; null where it states nothing.
Json errors_json(const l4d_coding_errors& e) {
  if (e.stated == 0) return Json();
  const auto of_color = [&](double error) { return e.colors_stated != 0 ? Json(error) : Json(); };
  return {{"position_sizes", e.position},
          {"covariance_factor", e.covariance},
          {"seen_opacity", e.opacity},
          {"visible_position", e.visible},
          {"mean_t_sigmas", e.mean_t},
          {"base_color", of_color(e.base_color)},
          {"directional_color", of_color(e.directional_color)},
          {"bounds",
           {{"position_sizes", e.position_bound},
            {"covariance_factor", e.covariance_bound},
            {"seen_opacity", e.opacity_bound},
            {"visible_position", e.visible_bound},
            {"base_color", of_color(e.base_color_bound)},
            {"directional_color", of_color(e.directional_color_bound)}}},
          {"min_size", e.min_size},
          {"own_min_sizes", e.own_min_sizes != 0}};
}

std::string errors_text(const l4d_coding_errors& e) {
  if (e.stated == 0) return "errors of single Gaussians: the stream states none\n";
  if (e.position == 0 && e.covariance == 1 && e.opacity == 0 && e.mean_t == 0 &&
      e.colors_stated != 0 && e.base_color == 0 && e.directional_color == 0) {
    return "errors of single Gaussians: none in place, shape, time, opacity and colour\n";
  }
  const auto bound = [](double b) {
    return b > 0 ? format(" (bound %.3g)", b) : std::string(" (no bound)");
  };
  std::string text = "errors of single Gaussians at most, as the encoder states them\n";
  text +=
      format("  %-18s %.3g of its size%s", "position", e.position, bound(e.position_bound).c_str());
  text += format("; sizes below %.3g%s count as that\n", e.min_size,
                 e.own_min_sizes != 0 ? ", or what the encoder was told of each," : "");
  text += format("  %-18s by a factor of %.3g%s\n", "variances", e.covariance,
                 bound(e.covariance_bound).c_str());
  text += format("  %-18s %.3g at any instant%s\n", "opacity", e.opacity,
                 bound(e.opacity_bound).c_str());
  text += format("  %-18s %.3g scene units%s\n", "while visible", e.visible,
                 bound(e.visible_bound).c_str());
  text += format("  %-18s %.3g of its standard deviation\n", "mean time", e.mean_t);
  if (e.colors_stated == 0) return text + "  colours            not stated\n";
  text +=
      format("  %-18s %.3g%s\n", "base colour", e.base_color, bound(e.base_color_bound).c_str());
  text += format("  %-18s %.3g in any direction%s\n", "directional colour", e.directional_color,
                 bound(e.directional_color_bound).c_str());
  return text;
}

}  // namespace

void add_errors(const Facts& facts, Outcome& outcome) {
  const bool is_ply = facts.input.is_scene();
  const l4d_coding_errors errors = is_ply ? l4d_coding_errors() : coding_errors(facts.decoder);
  outcome.json["stated_errors"] = errors_json(errors);
  if (!is_ply) outcome.text += "\n" + errors_text(errors);
}

}  // namespace l4d::cli
