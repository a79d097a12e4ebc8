// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/refit.h"

#include <string>
#include <utility>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/rendering.h"
#include "cli/text/units.h"
#include "eval/target/encoding.h"

namespace l4d::cli {
namespace {

Json json_of(const eval::CheckedStream& checked) {
  const eval::CheckedFidelity& f = checked.fidelity;
  return {{"fidelity", f.psnr},
          {"worst_camera", {{"id", f.camera}, {"fidelity", f.worst_camera}}},
          {"worst_instant", {{"time", f.instant}, {"fidelity", f.worst_instant}}}};
}

}  // namespace

void note_refit(Context& context, const eval::Refit& refit) {
  if (refit.is_left_out) {
    context.note("opacities are not fitted, which takes long in so many views; --refit fits them");
  } else if (!refit.search.trials.empty() && refit.is_missed()) {
    context.note(format("renders reach %.2f dB of the fidelity of %.2f dB that was aimed at",
                        refit.checked().fidelity.psnr, refit.fidelity));
  }
}

void describe_refit(const eval::Refit& refit, Outcome* outcome) {
  const size_t views = refit.check_views;
  const eval::CheckedStream& kept = refit.checked();
  Json& checked = outcome->json["checked"] = json_of(kept);
  checked["views"] = views;
  outcome->text +=
      format("renders: %.2f dB in %zu views apart; %.2f dB for camera %d, %.2f dB at %s s\n",
             kept.fidelity.psnr, views, kept.fidelity.worst_camera, kept.fidelity.camera,
             kept.fidelity.worst_instant, format_number(kept.fidelity.instant).c_str());
  if (!refit.fitted) return;
  const eval::PrunedScene& pruned = refit.pruned;
  Json j = {{"views", refit.fit_views},
            {"thresholds", Json::array()},
            {"kept", refit.is_kept},
            {"bytes", refit.fitted->bytes},
            {"seconds", refit.seconds}};
  if (refit.plain) {
    j["weights_alone"] = json_of(*refit.plain);
    j["weights_alone"]["bytes"] = refit.plain->bytes;
  }
  for (const eval::PruneTrial& trial : pruned.trials) {
    j["thresholds"].push_back({{"threshold", trial.threshold},
                               {"kept", trial.kept},
                               {"passes", trial.passes},
                               {"fidelity", trial.fidelity}});
  }
  if (refit.is_pruned()) j["chosen"] = pruned.result;
  std::string how;  // a target says that itself
  if (!refit.search.trials.empty()) {
    j["trials"] = Json::array();
    for (const eval::Trial& trial : refit.search.trials) {
      j["trials"].push_back({{"quality", trial.quality}, {"reached", trial.figure}});
    }
    const eval::Trial& best = refit.search.result();
    j["quality"] = best.quality;
    j["reached"] = best.figure;
    j["met"] = best.met;
    how =
        format(" at a quality of %.2f dB, in %zu trials", best.quality, refit.search.trials.size());
  }
  outcome->json["refit"] = j;
  std::string& text = outcome->text;
  if (refit.is_pruned()) {
    const eval::PruneTrial& trial = pruned.trials[pruned.result];
    text += format("pruned to %s Gaussians, opacities fitted in %u %s over %zu views",
                   format_count(trial.kept).c_str(), trial.passes,
                   trial.passes == 1 ? "pass" : "passes", refit.fit_views);
  } else {
    text += "nothing pruned: no threshold leaves enough fidelity";
  }
  text += format("; %s%s, in %s\n", format_bytes(refit.fitted->bytes).c_str(), how.c_str(),
                 format_seconds(refit.seconds).c_str());
  if (refit.plain) {
    text += format("weights alone: %s for %.2f dB%s\n", format_bytes(refit.plain->bytes).c_str(),
                   refit.plain->fidelity.psnr, refit.is_kept ? "" : ", kept: the fit does not pay");
  }
}

uint32_t refit_passes(const EncodeArguments& arguments, const std::optional<eval::Target>& target,
                      uint32_t backend, const EncoderHandle& encoder) {
  if (arguments.refit == "0" || !refit_obstacle(arguments, target).empty()) return 0;
  const bool can = eval::can_refit(encoder);
  if (arguments.refit.empty()) {
    if (!can || !arguments.has_all_views()) return 0;
    return eval::refit_defaults(backend, encoder.value(L4D_ENC_EFFORT)).passes;
  }
  if (!can) {
    throw usage_error("--refit: the preset '" + arguments.parameters.preset +
                      "' with what is set prunes nothing by a quality");
  }
  return static_cast<uint32_t>(parse_size(arguments.refit, "--refit"));
}

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

}  // namespace l4d::cli
