// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/importance.h"

#include <algorithm>
#include <utility>

#include "cli/command/values.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

// What alpha_t is worth for SH where no weight_sh was measured: light that an SH error changes,
// relative to the other components as the metric sum has them.
constexpr float kShPerAlphaT = 0.6f;

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
  verb->add_option("--visibility", visibility,
                   "Find out which Gaussians the views that are left out show: few (until hardly "
                   "anything new is "
                   "seen), all, none")
      ->type_name("WHICH")
      ->one_of({"few", "all", "none"})
      ->capture_default_str()
      ->excludes(all)
      ->group(group);
  verb->add_option("--metric", metric,
                   "gauss-newton: how far each attribute changes pixels, root mean square, in one "
                   "unit for all; sum: derivatives of the sum of pixels, as in the paper")
      ->type_name("NAME")
      ->one_of({"sum", "gauss-newton"})
      ->capture_default_str()
      ->group(group);
}

bool MeasureArguments::given() const {
  return !agreement.empty() || all_views || !max_share.empty() || metric != kDefault ||
         visibility != "few";
}

void MeasureArguments::check() const {
  const auto share = [](const std::string& text, const std::string& option) {
    const double value = text.empty() ? 1 : parse_number(text, option);
    if (!(value > 0 && value <= 1)) throw usage_error(option + " must be above 0 and at most 1");
  };
  share(agreement, "--agreement");
  share(max_share, "--max-share");
}

Json Importance::json() const {
  Json agreement = Json::object();
  for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    agreement[component_name(c)] = report.agreement[c];
  }
  return {{"views", report.views},
          {"views_measured", report.views_measured},
          {"views_visibility_only", report.views_visibility_only},
          {"rounds", report.rounds},
          {"agreed", report.agreed != 0},
          {"agreement", agreement},
          {"unseen", report.unseen},
          {"seconds", seconds}};
}

std::string Importance::text() const {
  std::string t =
      format("importance from %s of %s %s in %s", format_count(report.views_measured).c_str(),
             format_count(report.views).c_str(), made_up ? "made-up views" : "views",
             format_seconds(seconds).c_str());
  t += report.rounds > 1 || report.agreed != 0 ? "; halves agree to" : "";
  if (report.rounds > 1 || report.agreed != 0) {
    for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      t += format("%s %s %.3f", c == 0 ? "" : ",", component_name(c), report.agreement[c]);
    }
  }
  return t + format("\n%s %s in no view\n", format_items(report.unseen, "Gaussian").c_str(),
                    report.unseen == 1 ? "shows" : "show");
}

void EncoderImportance::set_weights(const std::string& name, io::Weights weights, uint32_t views,
                                    size_t num_gaussians) {
  if (weights.count != num_gaussians) {
    throw Failure(L4D_ERR_INVALID_SCENE, name + ": has weights of " + format_count(weights.count) +
                                             " Gaussians, the scene has " +
                                             format_count(num_gaussians));
  }
  weights_ = std::move(weights);
  views_ = views;
  if (weights_.sh.empty() || weights_.sh_is_clamped) {
    weights_.sh.clear();
    if (!weights_.gauss_newton) {
      for (const float w : weights_.alpha_t) weights_.sh.push_back(kShPerAlphaT * w);
    }
  }
}

void EncoderImportance::tell(const EncoderHandle& encoder) const {
  l4d_importance importance = weights_.view();
  importance.views = views_;
  if (has_min_sizes()) {
    importance.count = min_sizes_.size();
    importance.min_sizes = min_sizes_.data();
  }
  encoder.check(l4d_encoder_set_importance(encoder.get(), &importance));
}

}  // namespace l4d::cli
