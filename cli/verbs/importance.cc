// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/importance.h"

#include <algorithm>
#include <thread>
#include <utility>

#include "cli/rendered_scene.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"
#include "l4d/cuda.h"

namespace l4d::cli {
namespace {

// What alpha_t is worth for SH where no weight_sh was measured: light that an SH error changes,
// relative to the other components as the measure sum has them.
constexpr float kShPerAlphaT = 0.6f;

constexpr std::pair<uint32_t, std::vector<float> io::Weights::*> kColumns[] = {
    {L4D_WEIGHT_ALPHA_T, &io::Weights::alpha_t},
    {L4D_WEIGHT_SH, &io::Weights::sh},
    {L4D_WEIGHT_SCALE, &io::Weights::scale},
    {L4D_WEIGHT_ROTOR_SPATIAL, &io::Weights::rotor_spatial},
    {L4D_WEIGHT_ROTOR_TEMPORAL, &io::Weights::rotor_temporal},
    {L4D_WEIGHT_POSITION, &io::Weights::position},
    {L4D_WEIGHT_OPACITY, &io::Weights::opacity},
    {L4D_WEIGHT_MEAN_T, &io::Weights::mean_t}};

// The encoder has to know in which unit its weights are.
void tell_measure(const EncoderHandle& encoder, bool gauss_newton) {
  encoder.check(l4d_encoder_set(encoder.get(), L4D_ENC_WEIGHT_MEASURE, L4D_ALL_COMPONENTS,
                                gauss_newton ? 1 : 0));
}

}  // namespace

void MeasureArguments::add_options(Verb* verb) {
  const std::string group = "Importance from views";
  auto* agree =
      verb->add_option("--agreement", agreement,
                       "Measure views in rounds until the weights of two halves of them agree to "
                       "this rank correlation (default: 0.95, on a CUDA device 0.99)")
          ->type_name("R")
          ->group(group);
  auto* all = verb->add_flag("--all-views", all_views, "Measure every view")->group(group);
  all->excludes(agree);
  verb->add_option("--max-share", max_share, "Measure at most this share of the views (default: 1)")
      ->type_name("S")
      ->excludes(all)
      ->group(group);
  verb->add_option("--ask", ask,
                   "Ask views that are left out what they show: few (until hardly anything new is "
                   "seen), all, none")
      ->type_name("WHICH")
      ->one_of({"few", "all", "none"})
      ->capture_default_str()
      ->excludes(all)
      ->group(group);
  verb->add_option("--measure", measure,
                   "gauss-newton: how far each attribute changes pixels, root mean square, in one "
                   "unit for all; sum: derivatives of the sum of pixels, as in the paper")
      ->type_name("NAME")
      ->one_of({"sum", "gauss-newton"})
      ->capture_default_str()
      ->group(group);
}

bool MeasureArguments::given() const {
  return !agreement.empty() || all_views || !max_share.empty() || measure != kDefault ||
         ask != "few";
}

l4d_measure_options MeasureArguments::options() const {
  l4d_measure_options options;
  l4d_measure_options_init(&options);
  if (measure == "gauss-newton") options.sensitivity.measure = L4D_SENSITIVITY_GAUSS_NEWTON;
  options.sensitivity.seed = seed;
  if (!agreement.empty()) options.agreement = parse_number(agreement, "--agreement");
  if (!(options.agreement > 0 && options.agreement <= 1)) {
    throw usage_error("--agreement must be above 0 and at most 1");
  }
  options.ask_all = ask == "all" ? 1 : 0;
  options.skip_unseen = ask == "none" ? 1 : 0;
  if (all_views) options.agreement = 2;  // a correlation never gets there
  if (!max_share.empty()) options.max_share = parse_number(max_share, "--max-share");
  if (!(options.max_share > 0 && options.max_share <= 1)) {
    throw usage_error("--max-share must be above 0 and at most 1");
  }
  return options;
}

Importance measure_importance(Context& context, const std::string& verb, const io::Scene& scene,
                              const CameraViews& all, const MeasureArguments& arguments) {
  const Stopwatch watch;
  l4d_measure_options options = arguments.options();
  options.ranks = context.ranks().handle();
  std::vector<l4d_camera> cameras;
  for (const io::Camera& camera : all.set.cameras) cameras.push_back(camera.camera);
  std::vector<l4d_view> views;
  for (const io::View& view : all.views) {
    views.push_back({view.time, static_cast<uint32_t>(view.camera), 0});
  }
  Importance result;
  l4d_measure_report_init(&result.report);
  l4d_renderer_options rendering = renderer_options(context);
  // Views cost a device little: there is no need to be sparing of them.
  if (arguments.agreement.empty() && !arguments.all_views &&
      rendering.backend == L4D_BACKEND_CUDA) {
    options.agreement = 0.99;
  }
  const Ranks& ranks = context.ranks();
  uint32_t devices = 0;
  l4d_cuda_get_device_count(&devices);
  rendering.device = devices > 0 ? ranks.local_rank() % devices : 0;
  if (rendering.threads == 0 && ranks.local_count() > 1) {
    rendering.threads = std::max(1u, std::thread::hardware_concurrency() / ranks.local_count());
  }
  RendererHandle renderer(&rendering);
  const l4d_gaussians gaussians = scene.view();
  renderer.set_gaussians(gaussians, scene.timeline);
  l4d_sensitivity* measured = nullptr;
  {
    Progress progress(context, verb);
    renderer.check(l4d_measure(
        renderer.get(), cameras.data(), static_cast<uint32_t>(cameras.size()), views.data(),
        views.size(), &options, &Progress::callback, &progress, &result.report, &measured));
  }
  const SensitivityHandle sensitivity(measured, scene.count());
  result.weights.count = scene.count();
  result.weights.gauss_newton = options.sensitivity.measure == L4D_SENSITIVITY_GAUSS_NEWTON;
  for (const auto& [which, column] : kColumns) result.weights.*column = sensitivity.weights(which);
  result.seconds = watch.seconds();
  return result;
}

Json Importance::json() const {
  Json agreement = Json::object();
  for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    agreement[component_name(c)] = report.agreement[c];
  }
  return {{"views", report.views},
          {"views_measured", report.views_measured},
          {"views_asked", report.views_asked},
          {"rounds", report.rounds},
          {"agreed", report.agreed != 0},
          {"agreement", agreement},
          {"unseen", report.unseen},
          {"seconds", seconds}};
}

std::string Importance::text() const {
  std::string t =
      format("importance from %s of %s views in %s", format_count(report.views_measured).c_str(),
             format_count(report.views).c_str(), format_seconds(seconds).c_str());
  t += report.rounds > 1 || report.agreed != 0 ? "; halves agree to" : "";
  if (report.rounds > 1 || report.agreed != 0) {
    for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      t += format("%s %s %.3f", c == 0 ? "" : ",", component_name(c), report.agreement[c]);
    }
  }
  return t + format("\n%s Gaussians show in no view\n", format_count(report.unseen).c_str());
}

void EncoderWeights::set(const EncoderHandle& encoder, const std::string& name, io::Weights weights,
                         size_t num_gaussians) {
  weights_ = std::move(weights);
  if (weights_.count != num_gaussians) {
    throw Failure(L4D_ERR_INVALID_SCENE, name + ": has weights of " + format_count(weights_.count) +
                                             " Gaussians, the scene has " +
                                             format_count(num_gaussians));
  }
  if (weights_.sh.empty() || weights_.sh_is_clamped) {
    weights_.sh.clear();
    if (!weights_.gauss_newton) {
      for (const float w : weights_.alpha_t) weights_.sh.push_back(kShPerAlphaT * w);
    }
  }
  tell_measure(encoder, weights_.gauss_newton);
  for (const auto& [which, column] : kColumns) {
    const std::vector<float>& values = weights_.*column;
    if (values.empty()) continue;
    about(name, [&, which = which] {
      encoder.check(l4d_encoder_set_weights(encoder.get(), which, values.data(), values.size()));
    });
  }
}

}  // namespace l4d::cli
