// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "io/camera/cameras.h"
#include "io/image/image.h"

namespace l4d::train {

// An image as it is kept: 8 bits a channel.
struct Pixels {
  uint32_t width = 0, height = 0;
  std::vector<uint8_t> rgb;    // [height, width, 3]; not multiplied by alpha
  std::vector<uint8_t> alpha;  // [height, width]; empty: opaque
};

// The camera of an image that is scaled by `scale` in (0, 1]. Sizes are rounded, at least 1.
l4d_camera scaled_camera(const l4d_camera& camera, double scale);

// Averages by area. alpha may be empty.
Pixels resized(const io::Image& image, const std::vector<float>& alpha, uint32_t width,
               uint32_t height);
Pixels halved(const Pixels& pixels);  // 2 x 2 pixels become one; a last odd one is left out
using Colour = std::array<float, 3>;  // red, green, blue
io::Image image_of(const Pixels& pixels, const Colour& background);

// From images of a distorted camera to those of the pinhole camera of the same numbers.
class Undistortion {
 public:
  static constexpr uint64_t kBytes = 9;  // that it holds for a pixel
  Undistortion(const l4d_camera& camera, const io::Distortion& distortion);
  io::Image apply(const io::Image& image) const;
  // [height, width]: 0 where the pinhole camera sees what the distorted image does not show.
  const std::vector<uint8_t>& mask() const { return mask_; }

 private:
  uint32_t width_, height_;
  std::vector<float> source_;  // [height, width, 2] pixels of the distorted image
  std::vector<uint8_t> mask_;
};

// Where a distorted camera shows the direction (x, y, 1).
void distort(const io::Distortion& distortion, double x, double y, double* out /* [2] */);

}  // namespace l4d::train
