// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/report.h"

#include <algorithm>

#include "cli/command/progress.h"
#include "cli/text/units.h"
#include "cli/verbs/comparison_text.h"
#include "cli/verbs/encode/refit.h"
#include "eval/pair/pairing.h"

namespace l4d::cli {
namespace {

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
  outcome->text += format("%s: %s, %s, %.2f:1, %.1f bits per Gaussian, in %s\n", name.c_str(),
                          format_items(report.coded_gaussians, "Gaussian").c_str(),
                          format_bytes(report.file_bytes).c_str(), ratio, bits,
                          format_seconds(total_seconds).c_str());
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

}  // namespace

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

}  // namespace l4d::cli
