// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/refit.h"

#include <string>

#include "cli/text/units.h"

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

}  // namespace l4d::cli
