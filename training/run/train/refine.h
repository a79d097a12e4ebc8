// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "training/run/train/trainer.h"

namespace l4d::train {

// Finds clocks, places and lenses of the training cameras while the scene is trained: each step
// also changes those of its views a little, by Adam, within bounds. Medians over cameras stay 0, so
// that the scene stays where the test cameras look for it. What it has found is in the trainer's
// state. The arguments are borrowed; the capture is that of the loader and of the trainer.
class Refinement {
 public:
  // settings: resolved.
  Refinement(const Settings& settings, Capture* capture, ImageLoader* loader, Trainer* trainer);
  // After a step.
  void advance(const StepReport& step);
  // Cameras become what the trainer's state has of them, if that is another one now.
  void use_changes();
  // What the changes come to, one sentence each.
  std::vector<std::string> notes() const;

 private:
  void update(const ViewGradient& by_view, double rate, const CameraChange& bound,
              RefinedCamera* camera) const;

  Capture& capture_;
  ImageLoader& loader_;
  Trainer& trainer_;
  const Settings settings_;
  double first_rate_;
  std::vector<uint32_t> cameras_;  // that train
  std::vector<CameraChange>
      bounds_;  // by camera: how far their numbers may be from 0; 0: they stay
};

// Moves the cameras of a list as one, as if the world moved and grew, so that the medians of what
// they have found are 0; to first order in angles. refined: by camera of the capture.
void hold_medians(const Capture& capture, const std::vector<uint32_t>& cameras,
                  std::vector<RefinedCamera>* refined);

// Writes the cameras of a capture with their changes as a cameras.json that is a capture of the
// same images. all_frames: the capture is not a part of what its files have.
void write_refined(const std::string& path, const Capture& capture, bool all_frames);
// Gives a capture, and its loader, the cameras of such a file. Throws io::Error(CORRUPT) where they
// are others.
void follow_refined(const std::string& path, Capture* capture, ImageLoader* loader);

}  // namespace l4d::train
