// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "io/image.h"
#include "io/metrics.h"
#include "training/images/loader.h"

namespace l4d::train {

// The views of a split, at most `frames` instants of them, spread evenly; 0 = all.
std::vector<uint32_t> views_to_score(const Capture& capture, const char* split, uint32_t frames);

// At most `count` views of a split: instants spread evenly, and all cameras about equally often.
std::vector<uint32_t> views_to_watch(const Capture& capture, const char* split, size_t count);

struct Score {
  io::Fidelity plain;
  // After the affine map of colours of each view that fits best: how much of the error is exposure.
  double psnr_affine = 0;
};

// Adds views up. Images are compared on black; SSIM is NaN for images of less than 11 pixels.
class Scorer {
 public:
  // mask: [height, width] or empty.
  void add(const Pixels& captured, const std::vector<uint8_t>& mask, io::Image rendered,
           uint32_t threads);
  Score score() const;

 private:
  io::FidelityAccumulator sum_;
  double affine_ = 0;
};

using RenderView = std::function<io::Image(uint32_t view)>;
using IsCancelled = std::function<bool()>;

// Reads the views, renders them and compares. render: called on one thread. cancelled: may be null.
Score score_views(const Capture& capture, const ImageLoader& loader,
                  const std::vector<uint32_t>& views, uint32_t threads, const RenderView& render,
                  const IsCancelled& cancelled);

}  // namespace l4d::train
