// SPDX-License-Identifier: Apache-2.0
#include "eval/refit/view_encoding.h"

#include <utility>
#include <vector>

#include "eval/views/min_sizes.h"

namespace l4d::eval {

ViewEncoding encode_for_views(const EncoderHandle& encoder, const io::Scene& scene,
                              const CameraViews& views, const ViewEncodingOptions& options,
                              Observer& observer) {
  const l4d_renderer_options& renderer = options.rendering.renderer;
  const RefitDefaults defaults = refit_defaults(renderer.backend, encoder.value(L4D_ENC_EFFORT));
  const bool refits = options.refits && can_refit(encoder);
  const bool is_long = refits && renderer.backend != L4D_BACKEND_CUDA &&
                       is_long_fit(views, defaults.fit_views, scene.count());
  const auto measure = [&](const io::Scene& of, size_t most_views, bool skips_visibility) {
    l4d_measure_options measuring = measure_options(most_views, views.views.size(), options.seed);
    measuring.skip_visibility = skips_visibility ? 1 : 0;
    // Views cost a device little.
    if (most_views == 0 && renderer.backend == L4D_BACKEND_CUDA) measuring.agreement = 0.99;
    measuring.progress = &Observer::callback;
    measuring.progress_user = &observer;
    return measure_importance(renderer, of, views, measuring);
  };
  ViewEncoding out;
  out.importance = measure(scene, refits && !is_long ? defaults.views_before : 0, false);
  const std::vector<float> min_sizes = eval::min_sizes(scene, views.set, renderer.threads);
  const auto set_weights = [&](const io::Weights& weights) {
    l4d_importance importance = weights.view();
    importance.views = L4D_WEIGHT_VIEWS_ALL;
    importance.min_sizes = min_sizes.data();
    encoder.check(l4d_encoder_set_importance(encoder.get(), &importance));
  };
  set_weights(out.importance.weights);
  RefitCalls calls;
  calls.begin = [&](const std::string&) -> Observer& { return observer; };
  const auto encode = [&](QualitySearch* search) {
    if (!options.target) return encode_scene(observer, encoder, "", true, options.rendering.holder);
    TargetCalls trials;
    trials.begin = [&](size_t, double) -> Observer& { return observer; };
    trials.measure = [&](const Encoding& made, Observer& hears) {
      return measure_target(*options.target, Decoding(), hears, scene, made);
    };
    trials.holder = options.rendering.holder;
    Encoding best;
    *search = encode_to_target(*options.target, encoder, trials, &best).search;
    return best;
  };
  calls.encode_plain = [&] { return encode(&out.search); };
  QualitySearch fitted;
  if (options.target) {
    calls.encode_fitted = [&]() -> std::optional<Encoding> {
      Encoding made = encode(&fitted);
      if (out.search.result().met && !fitted.result().met) return std::nullopt;
      return made;
    };
  }
  calls.measure = [&](const io::Scene& part) {
    // What stays stays, whatever these views show; as for the scene where its views are many.
    const size_t most_views = is_long ? 0 : defaults.views_after;
    return measure(part, most_views, most_views > 0).weights;
  };
  calls.set_weights = set_weights;
  calls.holder = options.rendering.holder;
  if (!refits) {
    out.encoding = calls.encode_plain();
    return out;
  }
  RefitInput input{scene, out.importance.weights, views, options.rendering};
  if (!options.target) input.fidelity = encoder.value(L4D_ENC_QUALITY);
  input.passes = defaults.passes;
  input.fit_views = defaults.fit_views;
  input.max_render_bytes = options.max_render_bytes;
  input.drop_unseen = true;
  input.only_if_missed = is_long;
  input.preset = options.preset;
  out.refit = refit(input, encoder, calls);
  out.encoding = std::move(out.refit->encoding);
  if (options.target && out.refit->is_kept) out.search = std::move(fitted);
  return out;
}

}  // namespace l4d::eval
