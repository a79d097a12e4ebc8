// SPDX-License-Identifier: Apache-2.0
// Image files as the decoders of their formats see them.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "io/image/exr_header.h"
#include "io/image/image.h"

namespace l4d::io {

// The bytes of a file.
struct ImageFile {
  // Throws if it is a PNG or an EXR of another size than the limits, or an EXR that is not read.
  ImageFile(const std::string& name, const ImageLimits& limits);
  std::string path;
  std::shared_ptr<void> memory;  // counts them
  std::vector<uint8_t> bytes;
  std::optional<ExrHeader> exr;  // if it is one
};

// RGB or RGBA of 8 or 16 bits, these with the high byte first, in rows without gaps.
struct StoredImage {
  uint32_t width = 0, height = 0;
  unsigned channels = 0, depth = 0;
  std::vector<uint8_t> pixels;
  std::shared_ptr<void> memory;  // counts them, and the values that are made of them

  size_t row_bytes() const { return size_t{width} * channels * depth / 8; }
};

// Throws L4D_ERR_CORRUPT if the limits name another size.
void check_image_size(const std::string& path, uint32_t width, uint32_t height,
                      const ImageLimits& limits);

// Nothing if it has more than `deepest` bits a channel.
std::optional<StoredImage> decode_png(const ImageFile& file, unsigned deepest,
                                      const ImageLimits& limits);
// As it is stored, or, if only that has the size of the limits, turned as its EXIF orientation
// says. Throws if any of it is missing or damaged.
StoredImage decode_jpeg(const ImageFile& file, const ImageLimits& limits);

// Throws L4D_ERR_CORRUPT unless all blocks of pixels of the EXR are there, each with the place and
// the bytes that it has to have.
void check_exr(const ImageFile& file);
// The same, and L4D_ERR_CORRUPT where pixels are damaged as far as their compression shows that,
// L4D_ERR_IO where ffmpeg is missing. alpha_plane: as alpha of read_image, or null.
Image decode_exr(const ImageFile& file, std::vector<float>* alpha_plane, const ImageLimits& limits);

}  // namespace l4d::io
