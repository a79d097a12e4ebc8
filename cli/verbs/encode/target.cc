// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/target.h"

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/text/units.h"
#include "cli/verbs/comparison_text.h"
#include "cli/verbs/view_meter.h"

namespace l4d::cli {
namespace {

constexpr const char* kNames[] = {"size", "bitrate", "fidelity", "psnr-loss", "max-error", "jod"};

void check_views(const eval::Target& target, const CameraArguments& cameras) {
  if (!target.needs_views()) return;
  if (!cameras.given()) {
    throw usage_error(std::string("--target-") + kNames[static_cast<size_t>(target.kind)] +
                      " needs --cameras");
  }
  if (target.kind == eval::Target::Kind::kPsnrLoss && cameras.orbit > 0) {
    throw usage_error("--target-psnr-loss: made-up cameras have seen nothing");
  }
}

std::string obstacle_text(const eval::QualitySearch& search) {
  using Obstacle = eval::QualitySearch::Obstacle;
  switch (search.obstacle) {
    case Obstacle::kEndOfRange:
      return "the quality is at its end of " + format_number(search.low) + " dB";
    case Obstacle::kNoQualityBetween:
      return "qualities of " + format("%.2f and %.2f", search.low, search.high) +
             " dB lie on either side";
    case Obstacle::kTooManyTrials:
      return format("%zu trials did not come nearer", search.trials.size());
    default:
      return "";
  }
}

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
  verb->add_option("--target-jod", jod,
                   "Videos of renders at least this near the scene's in the worst camera, as "
                   "`compare --jod` measures it, below 10: 9.5; needs --cameras")
      ->type_name("JOD")
      ->group(group);
  verb->add_option("--display", display,
                   "Where videos are looked at, for --target-jod: standard_4k (default), "
                   "standard_fhd")
      ->type_name("NAME")
      ->group(group);
  verb->add_option("--max-error", max_error,
                   "Largest error of an attribute of `compare`, or of visible_position: "
                   "position=0.01, log_scale=0.1")
      ->type_name("NAME=V")
      ->group(group);
}

std::optional<eval::Target> parse_target(const TargetArguments& arguments,
                                         const CameraArguments& cameras) {
  const std::string* const texts[] = {&arguments.size,      &arguments.bitrate,
                                      &arguments.fidelity,  &arguments.psnr_loss,
                                      &arguments.max_error, &arguments.jod};
  std::optional<eval::Target> target;
  for (size_t k = 0; k < std::size(texts); ++k) {
    if (texts[k]->empty()) continue;
    if (target) throw usage_error("there can be one target only");
    target.emplace();
    target->kind = static_cast<eval::Target::Kind>(k);
  }
  if (!arguments.display.empty() && arguments.jod.empty()) {
    throw usage_error("--display needs --target-jod");
  }
  if (!target) return target;
  switch (target->kind) {
    case eval::Target::Kind::kSize:
      target->requested = static_cast<double>(parse_size(arguments.size, "--target-size"));
      break;
    case eval::Target::Kind::kBitrate:
      target->requested = parse_bitrate(arguments.bitrate, "--target-bitrate");
      break;
    case eval::Target::Kind::kFidelity:
      target->requested = parse_decibels(arguments.fidelity, "--target-fidelity");
      break;
    case eval::Target::Kind::kPsnrLoss:
      target->requested = parse_decibels(arguments.psnr_loss, "--target-psnr-loss");
      break;
    case eval::Target::Kind::kMaxError: {
      const ErrorBound bound = parse_error_bound(arguments.max_error);
      target->attribute = bound.name;
      target->requested = bound.limit;
      break;
    }
    case eval::Target::Kind::kJod:
      target->requested = parse_number(arguments.jod, "--target-jod");
      target->display = parse_display(arguments.display);
      if (!(target->requested < 10)) throw usage_error("--target-jod must be below 10");
      break;
  }
  if (!(target->requested > 0)) throw usage_error("a target must be positive");
  check_views(*target, cameras);
  return target;
}

std::string format_figure(const eval::Target& target, double figure) {
  using Kind = eval::Target::Kind;
  switch (target.kind) {
    case Kind::kSize:
      return format_bytes(static_cast<uint64_t>(figure));
    case Kind::kBitrate:
      return format_bytes(static_cast<uint64_t>(figure)) + "/s";
    case Kind::kFidelity:
      return format("%.2f dB of fidelity", figure);
    case Kind::kPsnrLoss:
      return format("%.3f dB of loss", figure);
    case Kind::kJod:
      return format("%.3f JOD", figure);
    default:
      return format_error(figure) + " of " + target.attribute;
  }
}

eval::Decoding decoding_of(Context& context, const std::vector<float>& min_sizes) {
  eval::Decoding decoding;
  decoding.decoder = context.decoder_options();
  decoding.threads = context.options.threads;
  decoding.min_sizes = min_sizes;
  decoding.holder = context.budget().holder();
  return decoding;
}

TargetReached encode_to_target(Context& context, const eval::Target& target,
                               const EncoderHandle& encoder, const std::string& name,
                               const io::Scene& scene, const CameraArguments& cameras,
                               const std::vector<float>& min_sizes, eval::Encoding* encoding) {
  const Stopwatch watch;
  std::optional<ViewMeter> meter;
  if (target.needs_views()) meter.emplace(context, target, name, scene, cameras);
  const eval::Decoding decoding = decoding_of(context, min_sizes);
  std::optional<Progress> progress;
  eval::TargetCalls calls;
  calls.begin = [&](size_t trial, double quality) -> eval::Observer& {
    progress.reset();
    return progress.emplace(context, "encode", format("trial %zu, %.2f dB", trial + 1, quality));
  };
  calls.holder = context.budget().holder();
  calls.measure = [&](const eval::Encoding& coded, eval::Observer& observer) {
    const double figure = meter ? meter->of(coded, observer)
                                : eval::measure_target(target, decoding, observer, scene, coded);
    progress->say(format_figure(target, figure) + ", " + format_figure(target, target.requested) +
                  " requested");
    return figure;
  };
  TargetReached reached;
  reached.target = target;
  reached.views = meter ? meter->num_views() : 0;
  const double before = watch.seconds();
  eval::TargetResult result = eval::encode_to_target(target, encoder, calls, encoding);
  reached.search = std::move(result.search);
  reached.seconds = before + result.seconds;
  return reached;
}

Json TargetReached::json() const {
  const eval::Trial& best = search.result();
  Json j = {{"kind", kNames[static_cast<size_t>(target.kind)]}};
  if (target.kind == eval::Target::Kind::kMaxError) j["attribute"] = target.attribute;
  j.update({{"requested", target.requested},
            {"reached", best.figure},
            {"met", best.met},
            {"quality", best.quality},
            {"trials", Json::array()}});
  for (const eval::Trial& trial : search.trials) {
    j["trials"].push_back({{"quality", trial.quality}, {"reached", trial.figure}});
  }
  if (const std::string why = obstacle_text(search); !why.empty()) j["obstacle"] = why;
  if (target.needs_views()) j["views"] = views;
  return j;
}

void TargetReached::note(Context& context) const {
  const eval::Trial& best = search.result();
  if (best.met) return;
  const std::string why = obstacle_text(search);
  context.note("not met: " + format_figure(target, target.requested) + " requested, " +
               format_figure(target, best.figure) + " is the nearest that was reached" +
               (why.empty() ? "" : ": " + why));
}

std::string TargetReached::text() const {
  const eval::Trial& best = search.result();
  std::string t = format("%s at a quality of %.2f dB, %s requested, in %zu trials",
                         format_figure(target, best.figure).c_str(), best.quality,
                         format_figure(target, target.requested).c_str(), search.trials.size());
  const std::string why = obstacle_text(search);
  if (best.met && !why.empty()) t += "\nnot nearer: " + why;
  return t + '\n';
}

}  // namespace l4d::cli
