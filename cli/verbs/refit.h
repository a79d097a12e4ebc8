// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/camera_arguments.h"
#include "cli/common.h"
#include "cli/verbs/importance.h"
#include "eval/encoding.h"
#include "eval/views.h"

namespace l4d::cli {

// Views of the fit that are worth their time on processors.
inline constexpr size_t kHostFitViews = 150;

// What a refit is made of, borrowed.
struct RefitInput {
  const io::Scene& scene;
  const eval::CameraViews& views;
  const MeasureArguments& measure;
  // dB that the coded scene is to have; 0: what weights alone reach, and what a fit gains at as
  // many bytes.
  double fidelity;
  bool all_views;  // whether a Gaussian that no view shows is dropped
  // Where a fit would take long: only if weights alone miss the fidelity.
  bool only_if_missed;
};

// What a refit does to an encoder that has the scene and weights of it.
struct RefitCalls {
  // Encodes with the weights alone.
  std::function<eval::Encoding()> encode_plain;
  // Replaces opacities [N], as the scene has them, and weights [N], of which alpha_t is 0 for those
  // that go. Both live as long as the refit. fidelity: what is aimed at, dB.
  std::function<void(const std::vector<float>& opacity, const io::Weights& weights,
                     double fidelity)>
      replace;
  // Encodes what was fitted, or returns nothing where that is no good. Without it: until renders
  // have the fidelity aimed at.
  std::function<std::optional<eval::Encoding>()> encode_fitted;
};

// Prunes a scene and fits the opacities of what stays, in views of the scene, and encodes it so
// that its renders have the fidelity that is aimed at. A build without the renderer has one that
// refuses to be made.
class Refit {
 public:
  // Renders the scene in the views of the fit and in those of the check.
  Refit(Context& context, const std::string& name, const RefitInput& input);
  ~Refit();
  Refit(const Refit&) = delete;
  Refit& operator=(const Refit&) = delete;

  // always: also where weights alone are as good. weights: of all Gaussians of the scene.
  eval::Encoding encode(const EncoderHandle& encoder, const io::Weights& weights, uint32_t passes,
                        bool always, const RefitCalls& calls);

  bool is_kept() const;    // what was fitted, by encode()
  double seconds() const;  // but for the encode that is kept
  // Adds "checked", what renders of the stream have of the scene's in views that no fit used; and
  // "refit", if there was one.
  void describe(Outcome* outcome) const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace l4d::cli
