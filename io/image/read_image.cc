// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <new>
#include <utility>

#include "io/file/file.h"
#include "io/image/stored_image.h"

namespace l4d::io {
namespace {

bool is_jpeg(const ImageFile& file) {
  return file.bytes.size() >= 2 && file.bytes[0] == 0xff && file.bytes[1] == 0xd8;
}

float sample(const uint8_t* bytes, unsigned depth) {
  if (depth == 8) return static_cast<float>(*bytes) / 255;
  return static_cast<float>(bytes[0] << 8 | bytes[1]) / 65535;
}

// alpha: null, and what is transparent lies on black; or where it goes.
Image values_of(const StoredImage& in, std::vector<float>* alpha_plane) {
  Image image(in.width, in.height);
  const size_t sample_bytes = in.depth / 8;
  const size_t pixel_bytes = in.channels * sample_bytes;
  const bool has_alpha = in.channels == 4;
  const bool keeps_alpha = alpha_plane != nullptr;
  if (keeps_alpha) alpha_plane->resize(has_alpha ? size_t{in.width} * in.height : 0);
  for (size_t y = 0; y < in.height; ++y) {
    float* out = &image.rgb[y * 3 * in.width];
    for (size_t x = 0; x < in.width; ++x, out += 3) {
      const uint8_t* pixel = &in.pixels[y * in.row_bytes() + x * pixel_bytes];
      const float alpha = has_alpha ? sample(pixel + 3 * sample_bytes, in.depth) : 1.0F;
      if (keeps_alpha && has_alpha) (*alpha_plane)[y * in.width + x] = alpha;
      for (size_t c = 0; c < 3; ++c) {
        out[c] = (keeps_alpha ? 1.0F : alpha) * sample(pixel + c * sample_bytes, in.depth);
      }
    }
  }
  return image;
}

// in: of 8 bits a channel.
ByteImage bytes_of(StoredImage in) {
  ByteImage out;
  out.width = in.width;
  out.height = in.height;
  if (in.channels == 3) {
    out.rgb = std::move(in.pixels);
    return out;
  }
  const size_t pixels = size_t{in.width} * in.height;
  out.rgb.resize(3 * pixels);
  out.alpha.resize(pixels);
  for (size_t i = 0; i < pixels; ++i) {
    std::copy_n(&in.pixels[4 * i], 3, &out.rgb[3 * i]);
    out.alpha[i] = in.pixels[4 * i + 3];
  }
  return out;
}

// Nothing if it has more than `deepest` bits a channel.
std::optional<StoredImage> decode(const ImageFile& file, unsigned deepest,
                                  const ImageLimits& limits) {
  if (is_jpeg(file)) return decode_jpeg(file, limits);
  return decode_png(file, deepest, limits);
}

template <typename Read>
auto with_memory(const std::string& path, const Read& read) {
  try {
    return read();
  } catch (const std::bad_alloc&) {
    throw Error(L4D_ERR_OUT_OF_MEMORY, path + ": not enough memory for the image");
  }
}

}  // namespace

ImageFile::ImageFile(const std::string& name, const ImageLimits& limits) : path(name) {
  InputFile file(path, limits.holder);
  uint8_t begin[kPngSizeBytes] = {};
  const size_t known = file.read(begin, sizeof(begin));
  uint32_t size[2];
  if (png_size(begin, size)) check_image_size(path, size[0], size[1], limits);
  if (is_exr(begin, known)) {
    exr = read_exr_header(&file);
    check_image_size(path, exr->width, exr->height, limits);
    file.seek(known);
  }
  memory = hold(limits.holder, file.size(), path);
  bytes.resize(static_cast<size_t>(file.size()));
  std::copy_n(begin, known, bytes.begin());
  bytes.resize(known + file.read(bytes.data() + known, bytes.size() - known));
}

void check_image_size(const std::string& path, uint32_t width, uint32_t height,
                      const ImageLimits& limits) {
  if (limits.width == 0 || (width == limits.width && height == limits.height)) return;
  throw Error(L4D_ERR_CORRUPT, path + " has " + std::to_string(width) + " x " +
                                   std::to_string(height) + " pixels, and the camera has " +
                                   std::to_string(limits.width) + " x " +
                                   std::to_string(limits.height));
}

Image read_image(const std::string& path, const ImageLimits& limits) {
  return read_image(path, nullptr, limits);
}

Image read_image(const std::string& path, std::vector<float>* alpha, const ImageLimits& limits) {
  return with_memory(path, [&] {
    const ImageFile file(path, limits);
    if (file.exr) return decode_exr(file, alpha, limits);
    return values_of(*decode(file, 16, limits), alpha);
  });
}

std::optional<ByteImage> read_image_bytes(const std::string& path, const ImageLimits& limits) {
  return with_memory(path, [&]() -> std::optional<ByteImage> {
    const ImageFile file(path, limits);
    if (file.exr) {
      check_exr(file);
      return std::nullopt;
    }
    std::optional<StoredImage> stored = decode(file, 8, limits);
    if (!stored) return std::nullopt;
    return bytes_of(std::move(*stored));
  });
}

}  // namespace l4d::io
