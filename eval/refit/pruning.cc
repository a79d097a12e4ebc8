// SPDX-License-Identifier: Apache-2.0
#include "eval/refit/pruning.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include "eval/refit/opacity_fit.h"
#include "eval/scene/motion.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::eval {
namespace {

// How far the part that stays lies above the fidelity wanted after half of the passes, in dB: what
// is aimed at; the least that a coding can do with; and where no other threshold is tried. The
// other passes bring 1 to 2 dB more.
constexpr double kMargin = 3, kLeast = 1.5, kEnough = 2, kTooMuch = 5;
constexpr size_t kMostTrials = 3;
// Decibels that the part loses where the threshold doubles, before two trials tell.
constexpr double kSlope = 5, kFlattest = 1.5, kSteepest = 10;
constexpr double kFirstThreshold = 1, kMostThreshold = 64, kMostChange = 16;

constexpr double kPi = 3.14159265358979323846;

// What the weights say of each Gaussian: [N].
struct Costs {
  std::vector<double> removal;  // squared error of the image without it; negative: no view shows it
  std::vector<float> contrast;  // as OpacityFit has it
};

Costs costs_of(const io::Scene& scene, const io::Weights& weights) {
  Costs costs;
  for (size_t i = 0; i < scene.count(); ++i) {
    const double opacity = linear_opacity(scene, i);
    const auto square = [](double v) { return v * v; };
    // Over all channels. A weight of SH is alpha T squared, times the mean of the basis squared.
    const double own = square(opacity * static_cast<double>(weights.opacity[i]));
    const double light = 4 * kPi * square(static_cast<double>(weights.sh[i]));
    // What shows in views that were not measured alone costs as good as nothing.
    costs.removal.push_back(weights.alpha_t[i] > 0 ? own / 3 : -1);
    costs.contrast.push_back(
        weights.alpha_t[i] > 0 ? static_cast<float>(own / std::max(light, 1e-30)) : -1.0f);
  }
  return costs;
}

// One threshold: what stays, and its fit.
struct Attempt {
  PruneTrial trial;
  std::vector<uint8_t> kept;
  std::unique_ptr<OpacityFit> fit;  // null where nothing stays
};

class Search {
 public:
  Search(const io::Scene& scene, const io::Weights& weights, FittingViews& views,
         const PruneOptions& options, Observer& observer)
      : scene_(scene),
        views_(views),
        options_(options),
        observer_(observer),
        costs_(costs_of(scene, weights)),
        light_(
            shared_light(views.rendering(), views.fit().views(), scene, costs_.contrast, observer)),
        ratio_(scene.count(), 1.0f),
        allowed_(std::pow(10.0, -options.fidelity / 10) / static_cast<double>(scene.count())) {}

  PrunedScene run() {
    double threshold = kFirstThreshold;
    while (out_.trials.size() < kMostTrials) {
      Attempt attempt = begin(threshold);
      // Half of the passes show how good the threshold is; the next one begins where this one ends.
      advance(attempt, out_.trials.empty() ? std::max(1u, options_.passes / 2) : 1);
      out_.trials.push_back(attempt.trial);
      const double above = attempt.trial.fidelity - options_.fidelity;
      if (above >= kLeast && (!best_ || best_->trial.threshold < threshold)) {
        best_ = std::move(attempt);
        out_.result = out_.trials.size() - 1;
      }
      if (above >= kEnough && (above <= kTooMuch || threshold >= kMostThreshold)) break;
      threshold = next_threshold();
    }
    finish();
    return std::move(out_);
  }

 private:
  Attempt begin(double threshold) {
    Attempt attempt;
    attempt.trial.threshold = threshold;
    for (const double cost : costs_.removal) {
      const bool goes = cost < 0 ? options_.drop_unseen : cost < threshold * allowed_;
      attempt.kept.push_back(goes ? 0 : 1);
      attempt.trial.kept += goes ? 0 : 1;
    }
    if (attempt.trial.kept == 0) return attempt;
    attempt.fit = std::make_unique<OpacityFit>(views_.rendering(), views_.fit(), scene_, light_,
                                               attempt.kept, ratio_);
    return attempt;
  }

  void advance(Attempt& attempt, uint32_t passes) {
    if (attempt.fit == nullptr || passes == 0) return;
    for (uint32_t k = 0; k < passes; ++k) attempt.fit->pass(observer_);
    attempt.trial.passes += passes;
    RenderedScene part(views_.rendering(), &attempt.fit->part(), "the scene that is pruned");
    attempt.trial.fidelity = views_.check().fidelity(part, observer_).psnr;
    for (size_t i = 0, row = 0; i < ratio_.size(); ++i) {
      if (attempt.kept[i] != 0) ratio_[i] = attempt.fit->ratios()[row++];
    }
  }

  // Decibels are about linear in the logarithm of the threshold.
  double next_threshold() const {
    const PruneTrial& last = out_.trials.back();
    double slope = kSlope;
    if (out_.trials.size() > 1) {
      const PruneTrial& before = out_.trials[out_.trials.size() - 2];
      slope = std::clamp(
          (before.fidelity - last.fidelity) / std::log2(last.threshold / before.threshold),
          kFlattest, kSteepest);
    }
    const double factor = std::exp2((last.fidelity - options_.fidelity - kMargin) / slope);
    return std::min(last.threshold * std::clamp(factor, 1 / kMostChange, kMostChange),
                    kMostThreshold);
  }

  // Completes the fit of the best attempt; without one, all Gaussians stay.
  void finish() {
    out_.opacity = scene_.opacity;
    if (!best_) {
      out_.result = out_.trials.size();
      out_.kept.assign(scene_.count(), 1);
      out_.part = scene_;
      return;
    }
    const uint32_t done = best_->trial.passes;
    advance(*best_, options_.passes - std::min(done, options_.passes));
    out_.trials[out_.result] = best_->trial;
    const bool logit = (scene_.flags & L4D_OPACITY_LOGIT) != 0;
    out_.part = best_->fit->part();
    size_t row = 0;
    for (size_t i = 0; i < scene_.count(); ++i) {
      if (best_->kept[i] == 0) continue;
      const float fitted = out_.part.opacity[row];
      if (best_->fit->ratios()[row++] == 1.0f) continue;
      out_.opacity[i] = logit ? static_cast<float>(io::logit(static_cast<double>(fitted))) : fitted;
    }
    out_.kept = std::move(best_->kept);
  }

  const io::Scene& scene_;
  FittingViews& views_;
  const PruneOptions& options_;
  Observer& observer_;
  Costs costs_;
  SharedLight light_;
  std::vector<float> ratio_;     // [N] of opacities, as they were fitted last, to the scene's
  double allowed_;               // squared error of the image for each Gaussian
  std::optional<Attempt> best_;  // the largest threshold that leaves enough to the coding
  PrunedScene out_;
};

MeterOptions keeping(uint64_t bytes, const io::Hold& holder) {
  MeterOptions options;
  options.max_render_bytes = bytes;
  options.holder = holder;
  return options;
}

}  // namespace

FittingViews::FittingViews(Rendering rendering, const io::Scene& scene, const CameraViews& views,
                           size_t most, Observer& observer, uint64_t max_render_bytes)
    : FittingViews(std::move(rendering), scene, deal_views(views, most), observer,
                   max_render_bytes) {}

FittingViews::FittingViews(Rendering rendering, const io::Scene& scene, DealtViews dealt,
                           Observer& observer, uint64_t max_render_bytes)
    : rendering_(std::move(rendering)),
      original_(rendering_, &scene, "the scene"),
      fit_(original_, std::move(dealt.fit), keeping(max_render_bytes / 3 * 2, rendering_.holder),
           observer),
      check_(original_, std::move(dealt.check), keeping(max_render_bytes / 3, rendering_.holder),
             observer) {}

PrunedScene prune_scene(const io::Scene& scene, const io::Weights& weights, FittingViews& views,
                        const PruneOptions& options, Observer& observer) {
  return Search(scene, weights, views, options, observer).run();
}

}  // namespace l4d::eval
