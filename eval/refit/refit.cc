// SPDX-License-Identifier: Apache-2.0
#include "eval/refit/refit.h"

#include <cfloat>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <utility>

#include "eval/target/target.h"

namespace l4d::eval {
namespace {

// More than the fidelity aimed at, in dB, that is not worth another encode.
constexpr double kTolerance = 0.4;
// What a fit gains at as many bytes, about, in dB.
constexpr double kGain = 2;
constexpr size_t kMostTrials = 4;
// Bytes grow by this share with each decibel, about. A fit does not pay that saves less than 2 %.
constexpr double kBytesPerDecibel = 0.085, kPays = 0.98;
// How much further below the mean the worst camera or instant may be than with weights alone, in
// dB, where it is worse than theirs.
constexpr double kMostSpread = 1.5;

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

bool pays(const CheckedStream& fitted, const CheckedStream& plain) {
  const double lost = plain.fidelity.psnr - fitted.fidelity.psnr;
  const double equal = static_cast<double>(plain.bytes) * std::exp(-kBytesPerDecibel * lost);
  return static_cast<double>(fitted.bytes) <= kPays * equal;
}

// Whether no camera and no instant pays for what others gain.
bool is_even(const CheckedStream& fitted, const CheckedStream& plain) {
  const double spread = fitted.fidelity.psnr - fitted.worst();
  return fitted.worst() >= plain.worst() ||
         spread <= plain.fidelity.psnr - plain.worst() + kMostSpread;
}

// One refit, step by step.
class Refitting {
 public:
  Refitting(const RefitInput& input, const EncoderHandle& encoder, const RefitCalls& calls)
      : input_(input),
        encoder_(encoder),
        calls_(calls),
        views_(input.rendering, input.scene, input.views, input.fit_views, calls.begin(""),
               input.max_render_bytes) {
    out_.fit_views = views_.fit().num_views();
    out_.check_views = views_.check().num_views();
    out_.fidelity = input.fidelity;
  }

  Refit run() {
    if (!input_.always || calls_.encode_fitted) {
      out_.encoding = not_counted(calls_.encode_plain);
      out_.plain = check(out_.encoding.stream, calls_.begin(""));
      // Also where a target chose the quality.
      out_.is_left_out =
          input_.only_if_missed && out_.plain->fidelity.psnr >= out_.fidelity - Refit::kMissed;
      if (out_.is_left_out) return finish();
      if (out_.fidelity == 0) out_.fidelity = out_.plain->fidelity.psnr + kGain;
    }
    fit();
    std::optional<Encoding> fitted =
        calls_.encode_fitted ? not_counted(calls_.encode_fitted) : encode();
    if (!fitted) return finish();
    if (!out_.fitted) out_.fitted = check(fitted->stream, calls_.begin(""));
    out_.is_kept = input_.always || is_better(*out_.fitted, *out_.plain);
    if (out_.is_kept) out_.encoding = std::move(*fitted);
    return finish();
  }

 private:
  using Clock = std::chrono::steady_clock;

  Refit finish() {
    out_.seconds = std::chrono::duration<double>(Clock::now() - begun_).count() - not_counted_;
    return std::move(out_);
  }

  // What `f` returns; its time is the caller's.
  template <typename T>
  T not_counted(const std::function<T()>& f) {
    const Clock::time_point begun = Clock::now();
    T result = f();
    not_counted_ += std::chrono::duration<double>(Clock::now() - begun).count();
    return result;
  }

  // Where weights alone miss the requested fidelity, a fit that comes clearly nearer costs what it
  // costs.
  bool is_better(const CheckedStream& fitted, const CheckedStream& plain) const {
    const bool mends = plain.fidelity.psnr < input_.fidelity - Refit::kMissed &&
                       fitted.fidelity.psnr > plain.fidelity.psnr + Refit::kMissed;
    return is_even(fitted, plain) && (mends || pays(fitted, plain));
  }

  CheckedStream check(const std::vector<unsigned char>& stream, Observer& observer) {
    RenderedScene coded(views_.rendering(), StreamBytes{stream.data(), stream.size()},
                        "the stream");
    return {stream.size(), views_.check().fidelity(coded, observer)};
  }

  void fit() {
    out_.pruned = prune_scene(input_.scene, input_.weights, views_,
                              {out_.fidelity, input_.passes, input_.drop_unseen}, calls_.begin(""));
    out_.weights = spread(calls_.measure(out_.pruned.part), out_.pruned.kept);
    out_.pruned.part = {};
    encoder_.check(l4d_encoder_set_fitted_opacity(encoder_.get(), out_.pruned.opacity.data()));
    calls_.set_weights(out_.weights);
    keep_color_bounds();
    for (const char* name : {L4D_ENC_PRUNE_WEIGHT, L4D_ENC_PRUNE_COST}) encoder_.set(name, 0);
  }

  void keep_color_bounds() {
    const EncoderHandle fresh;
    fresh.check(l4d_encoder_set_preset(fresh.get(), input_.preset.c_str()));
    const double below = fresh.value(L4D_ENC_QUALITY) - out_.fidelity;
    const double factor = std::pow(10.0, std::max(0.0, below) / 20);
    for (const char* name : {L4D_ENC_MAX_BASE_COLOR_ERROR, L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR}) {
      if (!input_.is_set(name)) encoder_.set(name, factor * encoder_.value(name));
    }
  }

  // Encodes what was fitted over and over, until its renders have the fidelity.
  Encoding encode() {
    // What pruning has taken of the error that is allowed.
    const double taken = out_.is_pruned()
                             ? std::pow(10.0, -out_.pruned.trials[out_.pruned.result].fidelity / 10)
                             : 0;
    encoder_.set(L4D_ENC_QUALITY, -10 * std::log10(std::pow(10.0, -out_.fidelity / 10) - taken));
    Target target;
    target.kind = Target::Kind::kFidelity;
    target.requested = out_.fidelity;
    target.tolerance = kTolerance;
    target.most_trials = kMostTrials;
    std::vector<CheckedStream> trials;
    TargetCalls calls;
    calls.begin = [&](size_t trial, double quality) -> Observer& {
      char label[64];
      std::snprintf(label, sizeof(label), "trial %zu, %.2f dB", trial + 1, quality);
      return calls_.begin(label);
    };
    calls.holder = calls_.holder;
    calls.measure = [&](const Encoding& coded, Observer& observer) {
      trials.push_back(check(coded.stream, observer));
      return trials.back().fidelity.psnr;
    };
    Encoding encoding;
    out_.search = encode_to_target(target, encoder_, calls, &encoding).search;
    out_.fitted = trials[out_.search.best];
    not_counted_ += encoding.report.total_seconds;
    // The trial that is best may not be the last.
    encoder_.set(L4D_ENC_QUALITY, out_.search.result().quality);
    return encoding;
  }

  const RefitInput& input_;
  const EncoderHandle& encoder_;
  const RefitCalls& calls_;
  Clock::time_point begun_ = Clock::now();
  double not_counted_ = 0;  // seconds
  FittingViews views_;
  Refit out_;
};

}  // namespace

Refit refit(const RefitInput& input, const EncoderHandle& encoder, const RefitCalls& calls) {
  return Refitting(input, encoder, calls).run();
}

}  // namespace l4d::eval
