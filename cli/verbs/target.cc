// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/target.h"

#include <cmath>

#include "cli/fidelity_meter.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

constexpr const char* kNames[] = {"size", "bitrate", "fidelity", "psnr-loss", "max-error"};

// How near is near enough: sizes and errors as shares, fidelity in dB, a loss as a share of it but
// no nearer than what renders of equal loss differ by.
constexpr double kSizeTolerance = 0.02;
constexpr double kErrorTolerance = 0.05;
constexpr double kFidelityTolerance = 0.1;
constexpr double kLossTolerance = 0.1;

Goal goal_of(const Target& target) {
  Goal goal;
  goal.asked = target.asked;
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
      goal.tolerance = kFidelityTolerance;
      break;
    case Target::Kind::kPsnrLoss:
      // Squared errors, while they are small against those of the scene itself.
      goal.at_most = goal.logarithm = true;
      goal.slope = std::log(10.0) / 10;
      goal.tolerance = -std::log1p(-kLossTolerance);
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
  l4d_encoder_parameter parameter;
  double added;  // factors count from 1, errors from 0
};
constexpr EncoderBound kBounds[] = {{"visible_position", L4D_ENC_MAX_VISIBLE_ERROR, 0},
                                    {"position", L4D_ENC_MAX_VISIBLE_ERROR, 0},
                                    {"position_sizes", L4D_ENC_MAX_POSITION_ERROR, 0},
                                    {"covariance_factor", L4D_ENC_MAX_COVARIANCE_FACTOR, 0},
                                    {"covariance", L4D_ENC_MAX_COVARIANCE_FACTOR, 1},
                                    {"seen_opacity", L4D_ENC_MAX_OPACITY_ERROR, 0}};

const EncoderBound* bound_of(const Target& target) {
  if (target.kind != Target::Kind::kMaxError) return nullptr;
  for (const EncoderBound& b : kBounds) {
    if (target.attribute == b.attribute) return &b;
  }
  return nullptr;
}

std::string drop_suffix(const std::string& text, const std::string& suffix) {
  const bool has = text.size() > suffix.size() &&
                   text.compare(text.size() - suffix.size(), suffix.size(), suffix) == 0;
  return has ? text.substr(0, text.size() - suffix.size()) : text;
}

// "1MB/s", "8Mbit/s", "125000": bytes per second.
double parse_bitrate(const std::string& text) {
  const std::string option = "--target-bitrate";
  const std::string amount = drop_suffix(text, "/s");
  const std::string bits = drop_suffix(amount, "bit");
  return bits != amount ? static_cast<double>(parse_size(bits, option)) / 8
                        : static_cast<double>(parse_size(amount, option));
}

void check_views(const Target& target, const CameraArguments& cameras) {
  if (!target.needs_views()) return;
  if (!cameras.given()) {
    throw usage_error(std::string("--target-") + kNames[static_cast<size_t>(target.kind)] +
                      " needs --cameras");
  }
  if (target.kind == Target::Kind::kPsnrLoss && cameras.orbit > 0) {
    throw usage_error("--target-psnr-loss: made-up cameras have seen nothing");
  }
}

// What a target measures of an encoding.
class Measurement {
 public:
  Measurement(Context& context, const Target& target, const std::string& name,
              const io::Scene& scene, const CameraArguments& cameras)
      : context_(context), target_(target), scene_(scene) {
    if (!target.needs_views()) return;
    CameraViews views = choose_views(context, cameras, "test", scene.timeline,
                                     [&] { return instant_of(scene, middle_of(scene.timeline)); });
    const bool chosen = !cameras.frames.empty() || !cameras.ids.empty();
    const size_t all = views.views.size();
    if (!chosen) views = spread_views(std::move(views));
    if (views.views.size() < all) {
      context.note(
          format("the target is measured in %zu of %zu views, spread evenly; --frames or "
                 "--ids choose others",
                 views.views.size(), all));
    }
    Progress progress(context, "encode", "original");
    meter_.emplace(context, progress, scene, name, std::move(views),
                   target.kind == Target::Kind::kPsnrLoss);
  }

  size_t num_views() const { return meter_ ? meter_->num_views() : 0; }

  double of(Progress& progress, const Encoding& encoding) {
    const double bytes = static_cast<double>(encoding.stream.size());
    switch (target_.kind) {
      case Target::Kind::kSize:
        return bytes;
      case Target::Kind::kBitrate:
        return bytes / io::duration(scene_.timeline);
      case Target::Kind::kFidelity:
        return meter_->fidelity(progress, encoding.stream);
      case Target::Kind::kPsnrLoss:
        return meter_->psnr_loss(progress, encoding.stream);
      default:
        return compare_encoding(context_, progress, scene_, "", encoding)
            .max_error(target_.attribute);
    }
  }

 private:
  Context& context_;
  const Target& target_;
  const io::Scene& scene_;
  std::optional<FidelityMeter> meter_;
};

}  // namespace

void TargetArguments::add_options(Verb* verb) {
  const std::string group = "A target in place of a quality";
  verb->add_option("--target-size", size, "At most this many bytes: 3MB, 500KiB, 123456")
      ->type_name("SIZE")
      ->group(group);
  verb->add_option("--target-bitrate", bitrate,
                   "At most this many bytes or bits per second of the sequence: 1MB/s, 8Mbit/s")
      ->type_name("RATE")
      ->group(group);
  verb->add_option("--target-fidelity", fidelity,
                   "Renders at least this near the scene's, as `compare --cameras` measures it: "
                   "42dB; needs --cameras")
      ->type_name("DB")
      ->group(group);
  verb->add_option("--target-psnr-loss", psnr_loss,
                   "Renders against what the cameras saw at most this much worse than the "
                   "scene's, mean PSNR: 0.2dB; needs --cameras with videos or images")
      ->type_name("DB")
      ->group(group);
  verb->add_option("--max-error", max_error,
                   "Largest error of an attribute of `compare`, or of visible_position: "
                   "position=0.01, log_scale=0.1")
      ->type_name("NAME=V")
      ->group(group);
}

std::optional<Target> parse_target(const TargetArguments& arguments,
                                   const CameraArguments& cameras) {
  const std::string* const texts[] = {&arguments.size, &arguments.bitrate, &arguments.fidelity,
                                      &arguments.psnr_loss, &arguments.max_error};
  std::optional<Target> target;
  for (size_t k = 0; k < std::size(texts); ++k) {
    if (texts[k]->empty()) continue;
    if (target) throw usage_error("there can be one target only");
    target.emplace();
    target->kind = static_cast<Target::Kind>(k);
  }
  if (!target) return target;
  switch (target->kind) {
    case Target::Kind::kSize:
      target->asked = static_cast<double>(parse_size(arguments.size, "--target-size"));
      break;
    case Target::Kind::kBitrate:
      target->asked = parse_bitrate(arguments.bitrate);
      break;
    case Target::Kind::kFidelity:
      target->asked = parse_decibels(arguments.fidelity, "--target-fidelity");
      break;
    case Target::Kind::kPsnrLoss:
      target->asked = parse_decibels(arguments.psnr_loss, "--target-psnr-loss");
      break;
    case Target::Kind::kMaxError: {
      const ErrorBound bound = parse_error_bound(arguments.max_error);
      target->attribute = bound.name;
      target->asked = bound.limit;
      break;
    }
  }
  if (!(target->asked > 0)) throw usage_error("a target must be positive");
  check_views(*target, cameras);
  return target;
}

std::string Target::format_figure(double figure) const {
  switch (kind) {
    case Kind::kSize:
      return format_bytes(static_cast<uint64_t>(figure));
    case Kind::kBitrate:
      return format_bytes(static_cast<uint64_t>(figure)) + "/s";
    case Kind::kFidelity:
      return format("%.2f dB of fidelity", figure);
    case Kind::kPsnrLoss:
      return format("%.3f dB of loss", figure);
    default:
      return format_error(figure) + " of " + attribute;
  }
}

TargetResult encode_to_target(Context& context, const Target& target, const EncoderHandle& encoder,
                              const std::string& name, const io::Scene& scene,
                              const CameraArguments& cameras, Encoding* encoding) {
  const Stopwatch watch;
  Measurement measurement(context, target, name, scene, cameras);
  l4d_parameter_info quality_info;
  l4d_parameter_info_init(&quality_info);
  encoder.check(l4d_encoder_parameter_info(L4D_ENC_QUALITY, &quality_info));
  const QualityRange range = {quality_info.min, quality_info.max,
                              get_parameter(encoder, L4D_ENC_QUALITY)};
  Encoding last;
  double kept_seconds = 0;
  const auto measure = [&](double quality, size_t trial) {
    Progress progress(context, "encode", format("trial %zu, %.2f dB", trial + 1, quality));
    encoder.check(l4d_encoder_set(encoder.get(), L4D_ENC_QUALITY, L4D_ALL_COMPONENTS, quality));
    last = encode_scene(progress, encoder, "", true);
    const double figure = measurement.of(progress, last);
    progress.say(target.format_figure(figure) + ", " + target.format_figure(target.asked) +
                 " asked for");
    return figure;
  };
  TargetResult result;
  result.target = target;
  result.views = measurement.num_views();
  const auto keep = [&] {
    *encoding = std::move(last);
    kept_seconds = encoding->report.total_seconds;
  };
  if (const EncoderBound* bound = bound_of(target)) {
    const double asked = target.asked + bound->added;
    const double before = get_parameter(encoder, bound->parameter);
    if (!(before > 0 && before <= asked)) {
      encoder.check(l4d_encoder_set(encoder.get(), bound->parameter, L4D_ALL_COMPONENTS, asked));
    }
    const double figure = measure(range.start, 0);
    if (figure <= target.asked) {
      keep();
      result.search.trials.push_back({range.start, figure, true});
      result.seconds = watch.seconds() - kept_seconds;
      return result;
    }
  }
  result.search = search_quality(goal_of(target), range, measure, keep);
  result.seconds = watch.seconds() - kept_seconds;
  return result;
}

Json TargetResult::json() const {
  const Trial& best = search.result();
  Json j = {{"kind", kNames[static_cast<size_t>(target.kind)]}};
  if (target.kind == Target::Kind::kMaxError) j["attribute"] = target.attribute;
  j.update({{"asked", target.asked},
            {"reached", best.figure},
            {"met", best.met},
            {"quality", best.quality},
            {"trials", Json::array()}});
  for (const Trial& trial : search.trials) {
    j["trials"].push_back({{"quality", trial.quality}, {"reached", trial.figure}});
  }
  if (!search.obstacle.empty()) j["obstacle"] = search.obstacle;
  if (target.needs_views()) j["views"] = views;
  return j;
}

std::string TargetResult::text() const {
  const Trial& best = search.result();
  std::string t = format("%s at a quality of %.2f dB, %s asked for, in %zu trials",
                         target.format_figure(best.figure).c_str(), best.quality,
                         target.format_figure(target.asked).c_str(), search.trials.size());
  if (!search.obstacle.empty())
    t += (best.met ? "\nnot nearer: " : "\nnot met: ") + search.obstacle;
  return t + '\n';
}

}  // namespace l4d::cli
