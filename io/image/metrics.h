// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "io/image/image.h"

namespace l4d::io {

// Differences of two images of one size, whose values are clamped to [0, 1] first; NaN is 0.
// Throw Error(L4D_ERR_INVALID_ARGUMENT) where sizes differ. mask: [height, width], not 0 where a
// pixel counts; empty: all do. NaN if none does.

// The mask that an image is: 255 where its channels are half white or more on average, else 0.
std::vector<uint8_t> mask_of(const Image& image);
// The image, black where the mask leaves no pixel.
Image masked(Image image, const std::vector<uint8_t>& mask);

// Mean squared error over all channels.
double mse(const Image& a, const Image& b, const std::vector<uint8_t>& mask = {});
// dB below the range 1; infinite for 0.
double psnr_of_mse(double mse);

// Structural similarity (Wang et al. 2004), as it is customary for novel views: Gaussian window of
// 11 x 11 with sigma 1.5 where it lies in the image as a whole, C1 = 0.01^2, C2 = 0.03^2, mean over
// pixels and channels. Images have at least 11 pixels a side. With a mask, windows around its
// pixels count, whatever else is in them. The result is the same for any number of threads; 0 = one
// per core.
double ssim(const Image& a, const Image& b, uint32_t threads = 1,
            const std::vector<uint8_t>& mask = {});

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
