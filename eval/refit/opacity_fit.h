// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "eval/image/fidelity_meter.h"
#include "eval/observer.h"
#include "eval/views/rendered_scene.h"
#include "io/scene/scene.h"

namespace l4d::eval {

// The light that each Gaussian of a scene shares with those in front of it and behind it, by which
// the steps of a fit are divided: in each of some subsets of views, which are spread over all
// instants.
struct SharedLight {
  std::vector<std::vector<float>> of_subset;  // [subset][N]; 0 = not seen
  std::vector<float> mean;                    // [N], over the subsets
};
// views: in the order of time. contrast: [N] squared change of a pixel, of the three channels
// together, where a Gaussian appears that hides everything behind it; negative: it has no light.
SharedLight shared_light(const Rendering& rendering, const CameraViews& views,
                         const io::Scene& scene, const std::vector<float>& contrast,
                         Observer& observer);

// Fits the opacities of a part of a scene so that its renders match those of the whole scene, by
// simultaneous iterative reconstruction with ordered subsets (OS-SIRT) and momentum. After each
// subset a Gaussian moves by the residual that it shows in its views over the light that it shares;
// so a pile of faint Gaussians does not overshoot. Gaussians without light keep their opacities.
// The result does not depend on the number of threads.
class OpacityFit {
 public:
  // whole: the scene that the part is of, in the views of the fit; light: of the whole scene. Both
  // must outlive this. kept: [N] 1 for the Gaussians of the part. ratio: [N] of the opacities that
  // the fit begins with to the scene's.
  OpacityFit(const Rendering& rendering, FidelityMeter& whole, const io::Scene& scene,
             const SharedLight& light, const std::vector<uint8_t>& kept,
             const std::vector<float>& ratio);

  // One pass: renders all views once, with a backward pass each.
  void pass(Observer& observer);

  // The part with its opacities as they are now, in [0, 1].
  const io::Scene& part() const { return part_; }
  // Opacity over the scene's, of the Gaussians of the part in their order: exactly 1 where nothing
  // has moved.
  const std::vector<float>& ratios() const { return ratio_; }

 private:
  // Half of the derivatives of the squared error of a subset by the ratios, [part().count()].
  // Returns the error.
  double differentiate(size_t subset, std::vector<float>* gradient, Observer& observer);
  void move(size_t subset, const std::vector<float>& gradient);
  size_t num_subsets() const { return light_.of_subset.size(); }

  const Rendering& rendering_;
  FidelityMeter& whole_;
  const SharedLight& light_;
  io::Scene part_;
  std::vector<uint32_t> source_;      // of each Gaussian of the part, in the scene
  std::vector<float> given_;          // opacities
  std::vector<float> ratio_, moved_;  // and by how much it did last
  uint32_t passes_ = 0;
  double error_ = -1;  // of the pass before; none yet
  double damping_ = 1;
};

}  // namespace l4d::eval
