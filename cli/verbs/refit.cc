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

// More than the fidelity aimed at, in dB, that is not worth another encode.
constexpr double kTolerance = 0.4;
constexpr size_t kMostTrials = 4;

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

}  // namespace

CheckedStream check_stream(Context& context, const std::string& name, const io::Scene& scene,
                           const eval::CameraViews& views,
                           const std::vector<unsigned char>& stream) {
  return about(name, [&] {
    Progress progress(context, "encode");
    eval::FittingViews dealt(rendering_of(context, "fast", 2), scene, views, progress);
    eval::RenderedScene coded(dealt.rendering(), eval::StreamBytes{stream.data(), stream.size()},
                              "the stream");
    return CheckedStream{dealt.check().num_views(), dealt.check().fidelity(coded, progress).psnr};
  });
}

struct Refit::Parts {
  Context& context;
  RefitInput input;
  std::optional<eval::FittingViews> views;
  eval::PrunedScene pruned;
  io::Weights weights;
  eval::QualitySearch search;  // of the encode
  double seconds = 0;          // but for the encode that is kept
};

Refit::Refit(Context& context, const std::string& name, const RefitInput& input,
             const io::Weights& weights)
    : parts_(new Parts{context, input, {}, {}, {}, {}, 0}) {
  const Stopwatch watch;
  about(name, [&] {
    Progress progress(context, "encode");
    parts_->views.emplace(rendering_of(context, "fast", 2), input.scene, input.views, progress);
    parts_->pruned = eval::prune_scene(input.scene, weights, *parts_->views,
                                       {input.fidelity, input.passes, input.all_views}, progress);
  });
  MeasureArguments how = input.measure;
  how.alone = true;  // other ranks have no part to measure
  const Importance again = about(name, [&] {
    return measure_importance(context, "encode", parts_->pruned.part, input.views, how);
  });
  parts_->weights = spread(again.weights, parts_->pruned.kept);
  parts_->pruned.part = {};
  parts_->seconds = watch.seconds();
}

Refit::~Refit() = default;

const std::vector<float>& Refit::opacity() const { return parts_->pruned.opacity; }
const io::Weights& Refit::weights() const { return parts_->weights; }
double Refit::fidelity() const { return parts_->input.fidelity; }
double Refit::seconds() const { return parts_->seconds; }

void Refit::encode(const EncoderHandle& encoder, eval::Encoding* encoding) {
  const double fidelity = parts_->input.fidelity;
  // What pruning has taken of the error that is allowed.
  const eval::PrunedScene& pruned = parts_->pruned;
  const double taken = pruned.result < pruned.trials.size()
                           ? std::pow(10.0, -pruned.trials[pruned.result].fidelity / 10)
                           : 0;
  encoder.set(L4D_ENC_QUALITY, -10 * std::log10(std::pow(10.0, -fidelity / 10) - taken));
  eval::Target target;
  target.kind = eval::Target::Kind::kFidelity;
  target.requested = fidelity;
  target.tolerance = kTolerance;
  target.most_trials = kMostTrials;
  std::optional<Progress> progress;
  eval::TargetCalls calls;
  calls.begin = [&](size_t trial, double quality) -> eval::Observer& {
    progress.reset();
    return progress.emplace(parts_->context, "encode",
                            format("trial %zu, %.2f dB", trial + 1, quality));
  };
  calls.holder = parts_->context.budget().holder();
  calls.measure = [&](const eval::Encoding& coded, eval::Observer& observer) {
    eval::RenderedScene stream(parts_->views->rendering(),
                               eval::StreamBytes{coded.stream.data(), coded.stream.size()},
                               "the stream");
    return parts_->views->check().fidelity(stream, observer).psnr;
  };
  eval::TargetResult result = eval::encode_to_target(target, encoder, calls, encoding);
  parts_->search = std::move(result.search);
  parts_->seconds += result.seconds;
  if (const eval::Trial& best = parts_->search.result(); !best.met) {
    parts_->context.note(
        format("renders reach %.2f dB of the fidelity of %.2f dB that was aimed at", best.figure,
               fidelity));
  }
}

Json Refit::json() const {
  const eval::PrunedScene& pruned = parts_->pruned;
  Json j = {{"views", parts_->views->fit().num_views()},
            {"check_views", parts_->views->check().num_views()},
            {"thresholds", Json::array()},
            {"seconds", parts_->seconds}};
  for (const eval::PruneTrial& trial : pruned.trials) {
    j["thresholds"].push_back({{"threshold", trial.threshold},
                               {"kept", trial.kept},
                               {"passes", trial.passes},
                               {"fidelity", trial.fidelity}});
  }
  if (pruned.result < pruned.trials.size()) j["chosen"] = pruned.result;
  j["trials"] = Json::array();
  for (const eval::Trial& trial : parts_->search.trials) {
    j["trials"].push_back({{"quality", trial.quality}, {"reached", trial.figure}});
  }
  j["quality"] = parts_->search.result().quality;
  j["reached"] = parts_->search.result().figure;
  j["met"] = parts_->search.result().met;
  return j;
}

std::string Refit::text() const {
  const eval::PrunedScene& pruned = parts_->pruned;
  std::string t;
  if (pruned.result < pruned.trials.size()) {
    const eval::PruneTrial& trial = pruned.trials[pruned.result];
    t = format("pruned to %s Gaussians, opacities fitted in %u passes over %zu views to %.2f dB",
               format_count(trial.kept).c_str(), trial.passes, parts_->views->fit().num_views(),
               trial.fidelity);
  } else {
    t = "nothing pruned: no threshold leaves enough fidelity";
  }
  const eval::Trial& best = parts_->search.result();
  return t + format("; %.2f dB at a quality of %.2f dB, in %zu trials, in %s\n", best.figure,
                    best.quality, parts_->search.trials.size(),
                    format_seconds(parts_->seconds).c_str());
}

}  // namespace l4d::cli
