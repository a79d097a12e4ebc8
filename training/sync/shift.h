// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "io/image/image.h"

// By how much one image is another one moved.
namespace l4d::train {

struct Shift {
  double x = 0, y = 0;  // pixels: the first image at p shows what the second one shows at p - shift
  double correlation = 0;  // of both, moved so
  double unmoved = 0;      // of both as they are
};

// Of less than `reach` pixels; 0 where the best lies at that border. Exposure and what is larger
// than some pixels do not matter. mask: [height, width] of pixels that count in the first image;
// empty: all.
Shift shift_between(const io::Image& first, const io::Image& second,
                    const std::vector<uint8_t>& mask, double reach);

}  // namespace l4d::train
