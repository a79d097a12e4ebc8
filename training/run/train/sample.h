// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>

#include "training/run/train/evaluate.h"
#include "training/run/train/output.h"
#include "training/run/train/trainer.h"

namespace l4d::train {

// Images that scores and previews use again and again. The capture and the loader are borrowed.
class Sample {
 public:
  // At most `most` views of the split. background: that of the trainer, behind images with alpha.
  Sample(const Capture& capture, const ImageLoader& loader, const char* split, size_t most,
         const Colour& background, uint32_t threads);
  Score score(Trainer* trainer) const;
  bool empty() const { return images_.empty(); }
  io::Image preview(Trainer* trainer) const;
  // What was captured, the scene and its stream.
  io::Image beside(Trainer* trainer, const RenderView& stream) const;

 private:
  const std::pair<const uint32_t, Pixels>& middle() const;

  const Capture& capture_;
  const ImageLoader& loader_;
  Colour background_;
  uint32_t threads_;
  std::map<uint32_t, Pixels> images_;
};

}  // namespace l4d::train
