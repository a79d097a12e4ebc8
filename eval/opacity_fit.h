// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "eval/fidelity_meter.h"
#include "eval/observer.h"
#include "eval/rendered_scene.h"
#include "io/scene/scene.h"

namespace l4d::eval {

// Fits the opacities of a part of a scene so that its renders match those of the whole scene, by
// simultaneous iterative reconstruction (SIRT) with momentum. Each Gaussian moves by the residual
// that it shows in all views together, over the light that it shares with those in front of it and
// behind it; so a pile of faint Gaussians does not overshoot. Gaussians that no view of the fit
// shows keep their opacities. The result does not depend on the number of threads.
class OpacityFit {
 public:
  // whole: the scene that the part is of, in the views of the fit; must outlive this. part: its
  // Gaussians that stay. contrast: [part.count()] squared change of a pixel, of the three channels
  // together, where a Gaussian appears that hides everything behind it; negative: it keeps its
  // opacity.
  OpacityFit(const Rendering& rendering, FidelityMeter& whole, io::Scene part,
             const std::vector<float>& contrast, Observer& observer);

  // Renders all views, with a backward pass each, and moves the opacities.
  void step(Observer& observer);

  // The part with its opacities as they are now, in [0, 1].
  const io::Scene& part() const { return part_; }
  // Opacity over the one given: exactly 1 where nothing has moved. [part().count()]
  const std::vector<float>& ratios() const { return ratio_; }
  // Sum of squared errors of all pixels and channels at the step before the last.
  double least_error() const { return least_error_; }

 private:
  // What a view adds for the images of the part and of the whole scene.
  void weigh(const std::vector<float>& contrast, Observer& observer);
  // Sets the opacities to those given times `ratio`.
  void set_ratios(const std::vector<float>& ratio);
  // The squared error, and half its derivatives by the ratios: [part().count()].
  double differentiate(std::vector<float>* gradient, Observer& observer);
  float within(size_t i, float ratio) const;

  const Rendering& rendering_;
  FidelityMeter& whole_;
  io::Scene part_;
  std::vector<float> given_;  // opacities
  std::vector<float> light_;  // sums by which steps are divided; 0 = in no view
  std::vector<float> ratio_, before_;
  // Where the error was least so far: ratios, and derivatives there.
  std::vector<float> best_, best_gradient_;
  double least_error_ = -1;  // none yet
  double momentum_ = 1;      // Nesterov's t
  float damping_ = 1;
};

}  // namespace l4d::eval
