// SPDX-License-Identifier: Apache-2.0
// WebP images, whose bytes are numbers: nothing is multiplied by alpha, and writing loses nothing.
// A build without libwebp (L4D_WEBP) has these functions too; they fail with
// L4D_ERR_FEATURE_UNSUPPORTED, and a message that says how to get one with it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "io/file/memory.h"

namespace l4d::io {

struct RgbaImage {
  uint32_t width = 0, height = 0;
  std::vector<uint8_t> rgba;  // [height, width, 4]
  std::shared_ptr<void> memory;

  size_t pixels() const { return size_t{width} * height; }
  const uint8_t* at(size_t pixel) const { return &rgba[4 * pixel]; }
};

// The size is read from the header, and what decoding takes is counted, before any of it is done.
RgbaImage decode_webp(const std::vector<uint8_t>& bytes, const std::string& name,
                      const Hold& holder);
std::vector<uint8_t> encode_webp(const RgbaImage& image, const std::string& name);

}  // namespace l4d::io
