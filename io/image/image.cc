// SPDX-License-Identifier: Apache-2.0
#include "io/image/image.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace l4d::io {
namespace {

// Steps of equal lightness (CIE L* 0, 12, 24, ...) through hues that people who do not tell red
// from green can follow as well.
constexpr float kErrorColors[][3] = {
    {0.000F, 0.000F, 0.000F}, {0.133F, 0.089F, 0.281F}, {0.328F, 0.121F, 0.455F},
    {0.534F, 0.194F, 0.495F}, {0.740F, 0.285F, 0.461F}, {0.902F, 0.419F, 0.364F},
    {0.968F, 0.607F, 0.309F}, {0.976F, 0.798F, 0.411F}, {0.984F, 0.965F, 0.736F}};
constexpr size_t kErrorSteps = std::size(kErrorColors) - 1;

}  // namespace

void to_bytes(const float* values, size_t count, uint8_t* bytes) {
  for (size_t i = 0; i < count; ++i) {
    const float low = values[i] > 0 ? values[i] : 0;  // false for NaN
    bytes[i] = static_cast<uint8_t>((low < 1 ? low : 1) * 255 + 0.5F);
  }
}

void from_bytes(const uint8_t* bytes, size_t count, float* values) {
  for (size_t i = 0; i < count; ++i) values[i] = static_cast<float>(bytes[i]) / 255;
}

Image side_by_side(const std::vector<Image>& images) {
  uint32_t width = 0;
  for (const Image& image : images) {
    if (image.height != images.front().height) {
      throw Error(L4D_ERR_INVALID_ARGUMENT, "images beside each other differ in height");
    }
    width += image.width;
  }
  if (width == 0) throw Error(L4D_ERR_INVALID_ARGUMENT, "there is no image to put beside others");
  Image out(width, images.front().height);
  size_t column = 0;
  for (const Image& image : images) {
    const size_t row_values = size_t{3} * image.width;
    for (size_t y = 0; y < image.height; ++y) {
      std::copy_n(&image.rgb[y * row_values], row_values, &out.rgb[y * 3 * width + column]);
    }
    column += row_values;
  }
  return out;
}

Image error_map(const Image& a, const Image& b, double gain) {
  if (!a.same_size(b)) throw Error(L4D_ERR_INVALID_ARGUMENT, "the images differ in size");
  Image out(a.width, a.height);
  for (size_t i = 0; i < out.rgb.size(); i += 3) {
    float sum = 0;
    for (size_t c = 0; c < 3; ++c) sum += std::abs(a.rgb[i + c] - b.rgb[i + c]);
    const float error = sum / 3 * static_cast<float>(gain);
    // What is no number is as wrong as can be.
    const float level = (error < 1 ? std::max(error, 0.0F) : 1) * static_cast<float>(kErrorSteps);
    const size_t step = std::min(static_cast<size_t>(level), kErrorSteps - 1);
    const float share = level - static_cast<float>(step);
    for (size_t c = 0; c < 3; ++c) {
      out.rgb[i + c] =
          kErrorColors[step][c] + share * (kErrorColors[step + 1][c] - kErrorColors[step][c]);
    }
  }
  return out;
}

}  // namespace l4d::io
