// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/refit.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <optional>
#include <utility>

#include "cli/rendering.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"
#include "eval/pruning.h"
#include "eval/target.h"

namespace l4d::cli {
namespace {

// More than the fidelity aimed at, in dB, that is not worth another encode; and what may be
// missing.
constexpr double kTolerance = 0.4, kMissed = 0.5;
// What a fit gains at as many bytes, about, in dB.
constexpr double kGain = 2;
constexpr size_t kMostTrials = 4;
// Views that are measured again where they are counted.
constexpr size_t kViewsAfter = 300;
// Views of the fit that are worth their time.
constexpr size_t kDeviceViews = 600;
// Bytes grow by this share with each decibel, about. A fit does not pay that saves less than 2 %,
// or whose worst camera or instant is below that of weights alone, and so much further below the
// mean, in dB.
constexpr double kBytesPerDecibel = 0.085, kPays = 0.98, kMostSpread = 1.5;

// Weights of the part that stays as weights of all: none of those that go.
io::Weights spread(const io::Weights& part, const std::vector<uint8_t>& kept) {
  io::Weights all;
  all.count = kept.size();
  all.gauss_newton = part.gauss_newton;
  for (const auto& [which, column] : io::kWeightColumns) {
    std::vector<float>& to = all.*column;
    to.assign(kept.size(), 0.0f);
    for (size_t i = 0, row = 0; i < kept.size(); ++i) {
      if (kept[i] != 0) to[i] = (part.*column)[row++];
    }
  }
  // What stays is not dropped because it shows in no view that was measured again.
  for (size_t i = 0; i < kept.size(); ++i) {
    if (kept[i] != 0) all.alpha_t[i] = std::max(all.alpha_t[i], FLT_MIN);
  }
  return all;
}

// A stream, and what renders of it have of the scene's.
struct Checked {
  uint64_t bytes = 0;
  eval::CheckedFidelity fidelity;

  double worst() const { return std::min(fidelity.worst_camera, fidelity.worst_instant); }

  Json json() const {
    return {{"fidelity", fidelity.psnr},
            {"worst_camera", {{"id", fidelity.camera}, {"fidelity", fidelity.worst_camera}}},
            {"worst_instant", {{"time", fidelity.instant}, {"fidelity", fidelity.worst_instant}}}};
  }
};

bool pays(const Checked& fitted, const Checked& plain) {
  const double lost = plain.fidelity.psnr - fitted.fidelity.psnr;
  const double equal = static_cast<double>(plain.bytes) * std::exp(-kBytesPerDecibel * lost);
  const double spread = fitted.fidelity.psnr - fitted.worst();
  return static_cast<double>(fitted.bytes) <= kPays * equal &&
         (fitted.worst() >= plain.worst() ||
          spread <= plain.fidelity.psnr - plain.worst() + kMostSpread);
}

}  // namespace

struct Refit::Parts {
  Context& context;
  std::string name;
  RefitInput input;
  std::optional<eval::FittingViews> views;
  std::optional<Checked> plain, fitted;
  bool is_kept = false;  // what was fitted
  eval::PrunedScene pruned;
  io::Weights weights;
  eval::QualitySearch search;
  double seconds = 0;  // but for the encode that is kept

  // What `f` does, named and timed.
  template <typename F>
  auto timed(const F& f) {
    const Stopwatch watch;
    struct AtEnd {
      const Stopwatch& watch;
      double* seconds;
      ~AtEnd() { *seconds += watch.seconds(); }
    } at_end{watch, &seconds};
    return about(name, f);
  }

  Checked check(const std::vector<unsigned char>& stream, eval::Observer& observer) {
    eval::RenderedScene coded(views->rendering(), eval::StreamBytes{stream.data(), stream.size()},
                              "the stream");
    return {stream.size(), views->check().fidelity(coded, observer)};
  }

  void fit(const io::Weights& given, uint32_t passes) {
    timed([&] {
      Progress progress(context, "encode");
      pruned = eval::prune_scene(input.scene, given, *views,
                                 {input.fidelity, passes, input.all_views}, progress);
    });
    MeasureArguments how = input.measure;
    how.alone = true;  // other ranks have no part to measure
    if (how.most_views > 0) {
      how.most_views = kViewsAfter;
      how.visibility = "none";  // what stays stays
    }
    weights = timed([&] {
      const Importance again = measure_importance(context, "encode", pruned.part, input.views, how);
      return spread(again.weights, pruned.kept);
    });
    pruned.part = {};
  }

  bool is_pruned() const { return pruned.result < pruned.trials.size(); }

  // Encodes the encoder's scene over and over, until its renders have the fidelity.
  eval::Encoding encode(const EncoderHandle& encoder) {
    // What pruning has taken of the error that is allowed.
    const double taken =
        is_pruned() ? std::pow(10.0, -pruned.trials[pruned.result].fidelity / 10) : 0;
    encoder.set(L4D_ENC_QUALITY, -10 * std::log10(std::pow(10.0, -input.fidelity / 10) - taken));
    eval::Target target;
    target.kind = eval::Target::Kind::kFidelity;
    target.requested = input.fidelity;
    target.tolerance = kTolerance;
    target.most_trials = kMostTrials;
    std::optional<Progress> progress;
    std::vector<Checked> trials;
    eval::TargetCalls calls;
    calls.begin = [&](size_t trial, double quality) -> eval::Observer& {
      progress.reset();
      return progress.emplace(context, "encode", format("trial %zu, %.2f dB", trial + 1, quality));
    };
    calls.holder = context.budget().holder();
    calls.measure = [&](const eval::Encoding& coded, eval::Observer& observer) {
      trials.push_back(check(coded.stream, observer));
      return trials.back().fidelity.psnr;
    };
    eval::Encoding encoding;
    eval::TargetResult result = eval::encode_to_target(target, encoder, calls, &encoding);
    search = std::move(result.search);
    fitted = trials[search.best];
    seconds += result.seconds;
    return encoding;
  }
};

Refit::Refit(Context& context, const std::string& name, const RefitInput& input)
    : parts_(new Parts{context, name, input, {}, {}, {}, false, {}, {}, {}, 0}) {
  parts_->timed([&] {
    Progress progress(context, "encode");
    const size_t most = context.backend() == L4D_BACKEND_CUDA ? kDeviceViews : kHostFitViews;
    parts_->views.emplace(rendering_of(context, "fast", 2), input.scene, input.views, most,
                          progress);
  });
}

Refit::~Refit() = default;

eval::Encoding Refit::encode(const EncoderHandle& encoder, const io::Weights& weights,
                             uint32_t passes, bool always, const RefitCalls& calls) {
  Parts& parts = *parts_;
  eval::Encoding plain;
  if (!always || calls.encode_fitted) {
    plain = calls.encode_plain();
    parts.plain = parts.timed([&] {
      Progress progress(parts.context, "encode");
      return parts.check(plain.stream, progress);
    });
    // Also where a target chose the quality.
    const bool missed = parts.plain->fidelity.psnr < parts.input.fidelity - kMissed;
    if (parts.input.only_if_missed && !missed) {
      parts.context.note(
          "opacities are not fitted, which takes long in so many views; --refit fits them");
      return plain;
    }
    if (parts.input.fidelity == 0) parts.input.fidelity = parts.plain->fidelity.psnr + kGain;
  }
  parts.fit(weights, passes);
  calls.replace(parts.pruned.opacity, parts.weights, parts.input.fidelity);
  if (calls.encode_fitted) {
    std::optional<eval::Encoding> fitted = calls.encode_fitted();
    if (!fitted) return plain;
    parts.fitted = parts.timed([&] {
      Progress progress(parts.context, "encode");
      return parts.check(fitted->stream, progress);
    });
    parts.is_kept = always || pays(*parts.fitted, *parts.plain);
    return parts.is_kept ? std::move(*fitted) : std::move(plain);
  }
  eval::Encoding fitted = about(parts.name, [&] { return parts.encode(encoder); });
  parts.is_kept = always || pays(*parts.fitted, *parts.plain);
  const double reached = (parts.is_kept ? *parts.fitted : *parts.plain).fidelity.psnr;
  if (reached < parts.input.fidelity - (parts.is_kept ? 0 : kMissed)) {
    parts.context.note(format("renders reach %.2f dB of the fidelity of %.2f dB that was aimed at",
                              reached, parts.input.fidelity));
  }
  return parts.is_kept ? std::move(fitted) : std::move(plain);
}

bool Refit::is_kept() const { return parts_->is_kept; }

double Refit::seconds() const { return parts_->seconds; }

void Refit::describe(Outcome* outcome) const {
  Parts& parts = *parts_;
  const size_t views = parts.views->check().num_views();
  const Checked& kept = parts.is_kept ? *parts.fitted : *parts.plain;
  Json& checked = outcome->json["checked"] = kept.json();
  checked["views"] = views;
  outcome->text +=
      format("renders: %.2f dB in %zu views apart; %.2f dB for camera %d, %.2f dB at %s s\n",
             kept.fidelity.psnr, views, kept.fidelity.worst_camera, kept.fidelity.camera,
             kept.fidelity.worst_instant, format_number(kept.fidelity.instant).c_str());
  if (!parts.fitted) return;
  const eval::PrunedScene& pruned = parts.pruned;
  Json j = {{"views", parts.views->fit().num_views()},
            {"thresholds", Json::array()},
            {"kept", parts.is_kept},
            {"bytes", parts.fitted->bytes},
            {"seconds", parts.seconds}};
  if (parts.plain) {
    j["weights_alone"] = parts.plain->json();
    j["weights_alone"]["bytes"] = parts.plain->bytes;
  }
  for (const eval::PruneTrial& trial : pruned.trials) {
    j["thresholds"].push_back({{"threshold", trial.threshold},
                               {"kept", trial.kept},
                               {"passes", trial.passes},
                               {"fidelity", trial.fidelity}});
  }
  if (parts.is_pruned()) j["chosen"] = pruned.result;
  std::string how;  // a target says that itself
  if (!parts.search.trials.empty()) {
    j["trials"] = Json::array();
    for (const eval::Trial& trial : parts.search.trials) {
      j["trials"].push_back({{"quality", trial.quality}, {"reached", trial.figure}});
    }
    const eval::Trial& best = parts.search.result();
    j["quality"] = best.quality;
    j["reached"] = best.figure;
    j["met"] = best.met;
    how =
        format(" at a quality of %.2f dB, in %zu trials", best.quality, parts.search.trials.size());
  }
  outcome->json["refit"] = j;
  std::string& text = outcome->text;
  if (parts.is_pruned()) {
    const eval::PruneTrial& trial = pruned.trials[pruned.result];
    text += format("pruned to %s Gaussians, opacities fitted in %u %s over %zu views",
                   format_count(trial.kept).c_str(), trial.passes,
                   trial.passes == 1 ? "pass" : "passes", parts.views->fit().num_views());
  } else {
    text += "nothing pruned: no threshold leaves enough fidelity";
  }
  text += format("; %s%s, in %s\n", format_bytes(parts.fitted->bytes).c_str(), how.c_str(),
                 format_seconds(parts.seconds).c_str());
  if (parts.plain) {
    text += format("weights alone: %s for %.2f dB%s\n", format_bytes(parts.plain->bytes).c_str(),
                   parts.plain->fidelity.psnr, parts.is_kept ? "" : ", kept: the fit does not pay");
  }
}

}  // namespace l4d::cli
