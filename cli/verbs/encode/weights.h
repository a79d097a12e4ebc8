// SPDX-License-Identifier: Apache-2.0
// The importance that the encoder gets: of a file, or measured from views.
#pragma once

#include <optional>

#include "cli/input/files.h"
#include "cli/verbs/encode/arguments.h"

namespace l4d::cli {

// The views that importance is measured from, and how.
struct Measuring {
  eval::CameraViews views;
  MeasureArguments how;
  bool made_up = false;    // for a scene that comes without cameras
  bool fits_long = false;  // a refit in these views, which nobody asked for, takes long

  // Views that the arguments ask for.
  Measuring(Context& context, const EncodeArguments& arguments, const io::Scene& scene)
      : views(
            choose_views(context, arguments.cameras, "train", scene.timeline,
                         [&] { return eval::instant_of(scene, eval::middle_of(scene.timeline)); })),
        how(how_of(arguments)) {}
  Measuring(const EncodeArguments& arguments, eval::CameraViews made_up_views)
      : views(std::move(made_up_views)), how(how_of(arguments)), made_up(true) {
    how.all_views = true;
    how.alone = true;  // they are few
  }

 private:
  static MeasureArguments how_of(const EncodeArguments& arguments) {
    MeasureArguments how = arguments.measure;
    how.seed = arguments.seed;
    // The thresholds of these presets are in units of sums.
    if (arguments.parameters.preset.rfind("paper-", 0) == 0) how.metric = "sum";
    return how;
  }
};
// passes: of a refit, 0 = none.
std::optional<Measuring> choose_measuring(Context& context, const EncodeArguments& arguments,
                                          const io::Scene& scene, uint32_t passes);
Importance measure(Context& context, const Input& input, const io::Scene& scene,
                   const Measuring& measuring);

constexpr const char* kMeasuredWeights = "measured weights";
// Gives the encoder the weights of a file or of views. Returns what was measured.
std::optional<Importance> set_weights(Context& context, const EncodeArguments& arguments,
                                      const Input& input, const io::Scene& scene,
                                      const EncoderHandle& encoder,
                                      const std::optional<Measuring>& measuring,
                                      std::optional<Output>& saved, EncoderImportance& told);

}  // namespace l4d::cli
