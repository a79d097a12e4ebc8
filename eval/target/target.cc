// SPDX-License-Identifier: Apache-2.0
#include "eval/target/target.h"

#include <chrono>
#include <cmath>
#include <utility>

namespace l4d::eval {
namespace {

// How near is near enough: sizes and errors as shares, fidelity in dB, a loss as a share of it but
// no nearer than what renders of equal loss differ by.
constexpr double kSizeTolerance = 0.02;
constexpr double kErrorTolerance = 0.05;
constexpr double kFidelityTolerance = 0.1;
constexpr double kLossTolerance = 0.1;
// What JOD falls short of that of equal videos, which has no units of its own.
constexpr double kJodOfEqual = 10, kJodTolerance = 0.1;

Goal goal_of(const Target& target) {
  Goal goal;
  goal.requested = target.requested;
  goal.most_trials = target.most_trials;
  switch (target.kind) {
    case Target::Kind::kSize:
    case Target::Kind::kBitrate:
      // A third of the numbers takes a bit more for 6 dB, roughly.
      goal.at_most = goal.rises = goal.logarithm = true;
      goal.slope = 0.08;
      goal.tolerance = -std::log1p(-kSizeTolerance);
      break;
    case Target::Kind::kFidelity:
      goal.rises = true;
      goal.tolerance = target.tolerance > 0 ? target.tolerance : kFidelityTolerance;
      break;
    case Target::Kind::kPsnrLoss:
      // Squared errors, while they are small against those of the scene itself.
      goal.at_most = goal.logarithm = true;
      goal.slope = std::log(10.0) / 10;
      goal.tolerance = -std::log1p(-kLossTolerance);
      break;
    case Target::Kind::kJod:
      goal.requested = kJodOfEqual - target.requested;
      goal.at_most = goal.logarithm = true;
      goal.slope = std::log(10.0) / 20;
      goal.tolerance = -std::log1p(-kJodTolerance);
      break;
    case Target::Kind::kMaxError:
      goal.at_most = goal.logarithm = true;
      goal.slope = std::log(10.0) / 20;
      goal.tolerance = -std::log1p(-kErrorTolerance);
      break;
  }
  return goal;
}

// A bound that the encoder keeps for each Gaussian, at the cost of those few that need it, in place
// of a quality that is raised for all.
struct EncoderBound {
  const char* attribute;
  const char* parameter;
  double added;  // factors count from 1, errors from 0
};
constexpr EncoderBound kBounds[] = {{"visible_position", L4D_ENC_MAX_VISIBLE_ERROR, 0},
                                    {"position", L4D_ENC_MAX_VISIBLE_ERROR, 0},
                                    {"position_sizes", L4D_ENC_MAX_POSITION_ERROR, 0},
                                    {"covariance_factor", L4D_ENC_MAX_COVARIANCE_FACTOR, 0},
                                    {"covariance", L4D_ENC_MAX_COVARIANCE_FACTOR, 1},
                                    {"seen_opacity", L4D_ENC_MAX_OPACITY_ERROR, 0},
                                    {"base_color", L4D_ENC_MAX_BASE_COLOR_ERROR, 0},
                                    {"directional_color", L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR, 0}};

const EncoderBound* bound_of(const Target& target) {
  if (target.kind != Target::Kind::kMaxError) return nullptr;
  for (const EncoderBound& b : kBounds) {
    if (target.attribute == b.attribute) return &b;
  }
  return nullptr;
}

QualityRange range_of(const EncoderHandle& encoder) {
  QualityRange range = {0, 0, encoder.value(L4D_ENC_QUALITY)};
  for (const l4d_parameter_info& info : EncoderHandle::parameters()) {
    if (info.name != std::string(L4D_ENC_QUALITY)) continue;
    range.lowest = info.min;
    range.highest = info.max;
  }
  return range;
}

}  // namespace

double measure_target(const Target& target, const Decoding& decoding, Observer& observer,
                      const io::Scene& scene, const Encoding& encoding) {
  const double bytes = static_cast<double>(encoding.stream.size());
  switch (target.kind) {
    case Target::Kind::kSize:
      return bytes;
    case Target::Kind::kBitrate:
      return bytes / io::duration(scene.timeline);
    case Target::Kind::kMaxError:
      return compare_encoding(decoding, observer, scene, "", encoding).max_error(target.attribute);
    default:
      throw io::Error(L4D_ERR_INVALID_ARGUMENT, "this target is measured in views");
  }
}

TargetResult encode_to_target(const Target& target, const EncoderHandle& encoder,
                              const TargetCalls& calls, Encoding* encoding) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begun = Clock::now();
  const QualityRange range = range_of(encoder);
  Encoding last;
  double kept_seconds = 0;
  const auto measure = [&](double quality, size_t trial) {
    Observer& observer = calls.begin(trial, quality);
    encoder.set(L4D_ENC_QUALITY, quality);
    last = {};
    last = encode_scene(observer, encoder, "", true, calls.holder);
    const double figure = calls.measure(last, observer);
    return target.kind == Target::Kind::kJod ? kJodOfEqual - figure : figure;
  };
  const auto keep = [&] {
    *encoding = std::move(last);
    kept_seconds = encoding->report.total_seconds;
  };
  TargetResult result;
  const auto finish = [&] {
    const double all = std::chrono::duration<double>(Clock::now() - begun).count();
    result.seconds = all - kept_seconds;
    return result;
  };
  if (const EncoderBound* bound = bound_of(target)) {
    const double requested = target.requested + bound->added;
    const double before = encoder.value(bound->parameter);
    if (!(before > 0 && before <= requested)) {
      encoder.set(bound->parameter, requested);
    }
    const double figure = measure(range.start, 0);
    if (figure <= target.requested) {
      keep();
      result.search.trials.push_back({range.start, figure, true});
      return finish();
    }
  }
  result.search = search_quality(goal_of(target), range, measure, keep);
  if (target.kind == Target::Kind::kJod) {
    for (Trial& trial : result.search.trials) trial.figure = kJodOfEqual - trial.figure;
  }
  return finish();
}

}  // namespace l4d::eval
