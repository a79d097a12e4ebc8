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

struct Score {
  io::Fidelity plain;
  // After the affine map of colours of each view that fits best: how much of the error is exposure.
  double psnr_affine = 0;
};

// Renders the views and compares them with what was captured, on black. render: image of a view,
// called on one thread. cancelled: may be null. SSIM is NaN for images of less than 11 pixels.
Score score_views(const Capture& capture, const ImageLoader& loader,
                  const std::vector<uint32_t>& views, uint32_t threads,
                  const std::function<io::Image(uint32_t view)>& render,
                  const std::function<bool()>& cancelled);

}  // namespace l4d::train
