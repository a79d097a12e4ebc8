// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "eval/image/fidelity_meter.h"
#include "eval/observer.h"
#include "eval/views/rendered_scene.h"
#include "io/ply/weights.h"

namespace l4d::eval {

// A scene in views that are dealt over all its instants (deal_views).
class FittingViews {
 public:
  // scene: must outlive this. views: those that its importance was measured from; of them about
  // `most` for the fit.
  // max_render_bytes: of renders of the scene that are kept; others are made again in each pass.
  static constexpr uint64_t kRenderBytes = uint64_t{3} << 30;
  FittingViews(Rendering rendering, const io::Scene& scene, const CameraViews& views, size_t most,
               Observer& observer, uint64_t max_render_bytes = kRenderBytes);
  FittingViews(const FittingViews&) = delete;
  FittingViews& operator=(const FittingViews&) = delete;

  const Rendering& rendering() const { return rendering_; }
  FidelityMeter& fit() { return fit_; }
  FidelityMeter& check() { return check_; }

 private:
  FittingViews(Rendering rendering, const io::Scene& scene, DealtViews dealt, Observer& observer,
               uint64_t max_render_bytes);

  Rendering rendering_;
  RenderedScene original_;
  FidelityMeter fit_, check_;
};

struct PruneOptions {
  double fidelity = 0;  // dB that the coded scene is to have
  uint32_t passes = 1;  // steps of a fit, at least 1
  // Whether Gaussians that show in no view go, too; else they stay and keep their bits.
  bool drop_unseen = false;
};

struct PruneTrial {
  // A Gaussian was left out if that alone costs less than this share of the error that is allowed
  // to each.
  double threshold = 0;
  uint64_t kept = 0;
  uint32_t passes = 0;
  double fidelity = 0;  // dB, of the part that stays, with its opacities fitted
};

struct PrunedScene {
  std::vector<uint8_t> kept;   // [N], 1: stays
  std::vector<float> opacity;  // [N], as the scene has them; of those that stay, as fitted
  io::Scene part;              // those that stay, with the opacities fitted
  std::vector<PruneTrial> trials;
  size_t result = 0;  // the trial that this is; trials.size() where all stay
};

// Leaves out Gaussians whose bits serve the image better elsewhere, and fits the opacities of the
// others. Chooses how many go by rendering: so many that what is left is 4.5 dB above the
// fidelity wanted, about, which leaves two thirds of the error to the coding. weights:
// Gauss-Newton's, of all Gaussians, with alpha_t, sh and opacity.
PrunedScene prune_scene(const io::Scene& scene, const io::Weights& weights, FittingViews& views,
                        const PruneOptions& options, Observer& observer);

}  // namespace l4d::eval
