// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "io/image/image.h"

namespace l4d::io {

// Differences of two images of one size, whose values are clamped to [0, 1] first; NaN is 0.
// Throw Error(L4D_ERR_INVALID_ARGUMENT) where sizes differ.

// Mean squared error over all channels.
double mse(const Image& a, const Image& b);
// dB below the range 1; infinite for 0.
double psnr_of_mse(double mse);

// Structural similarity (Wang et al. 2004), as it is customary for novel views: Gaussian window of
// 11 x 11 with sigma 1.5 where it lies in the image as a whole, C1 = 0.01^2, C2 = 0.03^2, mean over
// pixels and channels. Images have at least 11 pixels a side. The result is the same for any
// number of threads; 0 = one per core.
double ssim(const Image& a, const Image& b, uint32_t threads = 1);

// Of several views. NaN without a view, infinite where images are equal.
struct Fidelity {
  uint64_t views = 0;
  double psnr = 0;       // of the mean squared error of all views
  double min_psnr = 0;   // of the worst view
  double mean_psnr = 0;  // over views: what papers quote
  double mean_ssim = 0;
};

class FidelityAccumulator {
 public:
  void add(double mse, double ssim);
  Fidelity result() const;

 private:
  uint64_t views_ = 0;
  double mse_sum_ = 0, mse_max_ = 0, psnr_sum_ = 0, ssim_sum_ = 0;
};

}  // namespace l4d::io
