// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "io/file/memory.h"
#include "io/scene/scene.h"
#include "l4d/render.h"

namespace l4d::io {

// Colours as they are shown, nominally in [0, 1]: as the file has them, without any transfer
// function. Of EXR, whose colours are of light, they are what its picture has as a PNG: by the
// transfer function of sRGB.
struct Image {
  uint32_t width = 0, height = 0;
  std::vector<float> rgb;  // [height, width, 3]

  Image() = default;
  Image(uint32_t w, uint32_t h) : width(w), height(h), rgb(size_t{3} * w * h) {}
  bool same_size(const Image& other) const {
    return width == other.width && height == other.height;
  }
};

// An image of 8 bits a channel. alpha: [height, width]; empty if there is none. Colours are not
// multiplied by it.
struct ByteImage {
  uint32_t width = 0, height = 0;
  std::vector<uint8_t> rgb;  // [height, width, 3]
  std::vector<uint8_t> alpha;
};

// Between values and bytes: clamped, rounded to the nearest, NaN is 0.
void to_bytes(const float* values, size_t count, uint8_t* bytes);
void from_bytes(const uint8_t* bytes, size_t count, float* values);

// 8 bits a channel. level: of zlib, 1 (fast) to 9 (small).
std::string encode_png(const Image& image, int level);
// The same in a file, which appears under its name when it is complete. check: called for each row.
void write_png(const std::string& path, const Image& image, const Check& check = {});
// Width and height of a PNG from its first bytes; false if they are not those of a PNG.
constexpr size_t kPngSizeBytes = 24;
bool png_size(const uint8_t* begin /* [24] */, uint32_t* size /* [2] */);
// The same of a file, a PNG, a JPEG or an EXR; false if it is none or cannot be read. Throws what
// read_image throws of the header of an EXR.
bool image_size(const std::string& path, uint32_t* size /* [2] */);

// What names of files that read_image reads end with.
constexpr const char* kImageExtensions[] = {".png", ".jpg", ".jpeg", ".exr",
                                            ".PNG", ".JPG", ".JPEG", ".EXR"};

// What an image has to be, and what counts it.
struct ImageLimits {
  uint32_t width = 0, height = 0;  // pixels that it must have; 0 = any
  Hold holder;                     // counts the file and what reading it takes
};

// Any PNG or JPEG of up to L4D_MAX_IMAGE_SIDE pixels a side, or an EXR (io/image/exr_header.h says
// which), decoded by the program ffmpeg. Values of 16 bits and floats keep their precision,
// what is transparent lies on black, gamma and colour profiles are left aside as most programs of
// the field do. A JPEG is taken as it is stored, as COLMAP does; if the limits name its size with
// width and height exchanged, it is turned as its EXIF orientation says.
// Colours of an EXR, which have been multiplied by alpha, are divided by it, clamped, and shown by
// the transfer function of sRGB.
// Throws L4D_ERR_CORRUPT, before any pixel is decoded, if the image has another size than the
// limits.
Image read_image(const std::string& path, const ImageLimits& limits = {});
// The same with what is transparent as it is in the file. alpha: [height, width] in [0, 1]; empty
// if the image has none.
Image read_image(const std::string& path, std::vector<float>* alpha,
                 const ImageLimits& limits = {});
// The same as bytes, from which from_bytes makes these values. Nothing if the file has 16 bits a
// channel, or is a whole EXR.
std::optional<ByteImage> read_image_bytes(const std::string& path, const ImageLimits& limits = {});

// Images of one height beside each other.
Image side_by_side(const std::vector<Image>& images);
// The image with a black strip below, in which the captions stand from left to right, each in its
// equal part of the width; what does not fit is cut off. ASCII; other bytes are left blank.
Image captioned(const Image& image, const std::vector<std::string>& captions);
// Mean absolute difference of the channels times `gain`, as colours from black (0) over violet and
// orange to pale yellow (1 and more). The lightness of the colours rises evenly.
Image error_map(const Image& a, const Image& b, double gain);

}  // namespace l4d::io
