// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/weights.h"

#include "eval/refit/refit.h"
#include "eval/target/encoding.h"
#include "io/ply/weights.h"

namespace l4d::cli {
namespace {

// Importance from views that are made up; none where they show nothing or there is no memory for
// them, since the user did not ask for any.
std::optional<Importance> look_around(Context& context, const EncodeArguments& arguments,
                                      const Input& input, const io::Scene& scene) {
  const auto may_be_left_out = [](const std::string& status) {
    return status == l4d_status_name(L4D_ERR_INVALID_SCENE) ||
           status == l4d_status_name(L4D_ERR_LIMIT_EXCEEDED);
  };
  try {
    const Measuring measuring = about(input.name(), [&] {
      return Measuring(arguments, eval::made_up_views(scene, context.budget().holder()));
    });
    return measure(context, input, scene, measuring);
  } catch (const Failure& failure) {
    if (!may_be_left_out(failure.name())) throw;
    context.note(std::string("importance is estimated, without views that are made up: ") +
                 failure.what());
    return std::nullopt;
  }
}

}  // namespace

Importance measure(Context& context, const Input& input, const io::Scene& scene,
                   const Measuring& measuring) {
  Importance importance = about(input.name(), [&] {
    return measure_importance(context, "encode", scene, measuring.views, measuring.how);
  });
  importance.made_up = measuring.made_up;
  if (importance.report.unseen == scene.count()) {
    throw Failure(L4D_ERR_INVALID_SCENE, "the cameras show nothing of " + input.name());
  }
  return importance;
}

std::optional<Importance> set_weights(Context& context, const EncodeArguments& arguments,
                                      const Input& input, const io::Scene& scene,
                                      const EncoderHandle& encoder,
                                      const std::optional<Measuring>& measuring,
                                      std::optional<Output>& saved, EncoderImportance& told) {
  const auto tell = [&](const std::string& name, io::Weights weights, uint32_t views) {
    told.set_weights(name, std::move(weights), views, scene.count());
    about(name, [&] { told.tell(encoder); });
  };
  if (!arguments.weights.empty()) {
    tell(arguments.weights,
         about(arguments.weights,
               [&] { return io::read_weights_ply(arguments.weights, context.budget().holder()); }),
         L4D_WEIGHT_VIEWS_UNKNOWN);
  }
  std::optional<Importance> importance;
  if (measuring) {
    importance = measure(context, input, scene, *measuring);
  } else if (arguments.may_look_around() && eval::has_quality(encoder)) {
    importance = look_around(context, arguments, input, scene);
  }
  if (!importance) return std::nullopt;
  if (saved) {
    io::write_weights_ply(saved->path(), importance->weights);
    saved->finish();
  }
  tell(kMeasuredWeights, std::move(importance->weights),
       importance->made_up ? uint32_t{L4D_WEIGHT_VIEWS_SOME} : arguments.weight_views());
  return importance;
}

std::optional<Measuring> choose_measuring(Context& context, const EncodeArguments& arguments,
                                          const io::Scene& scene, uint32_t passes) {
  std::optional<Measuring> measuring;
  if (!arguments.measures()) return measuring;
  measuring.emplace(context, arguments, scene);
  if (passes == 0) return measuring;
  const eval::RefitDefaults defaults = eval::refit_defaults(context.backend());
  measuring->fits_long = arguments.refit.empty() && context.backend() != L4D_BACKEND_CUDA &&
                         eval::is_long_fit(measuring->views, defaults.fit_views, scene.count());
  if (!measuring->fits_long && !arguments.measure.given()) {
    measuring->how.most_views = defaults.views_before;
  }
  return measuring;
}

}  // namespace l4d::cli
