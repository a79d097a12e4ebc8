// SPDX-License-Identifier: Apache-2.0
#include "io/formats/webp.h"

#include <webp/decode.h>
#include <webp/encode.h>

#include <cstdlib>

#include "io/scene/scene.h"

namespace l4d::io {
namespace {

constexpr size_t kChannels = 4;
// What the library needs besides the result: its own image, as wide, and tables.
constexpr uint64_t kDecoderBytes = 4, kTableBytes = uint64_t{1} << 20;

}  // namespace

RgbaImage decode_webp(const std::vector<uint8_t>& bytes, const std::string& name,
                      const Hold& holder) {
  WebPBitstreamFeatures features;
  if (WebPGetFeatures(bytes.data(), bytes.size(), &features) != VP8_STATUS_OK ||
      features.has_animation != 0 || features.width < 1 || features.height < 1) {
    throw Error(L4D_ERR_CORRUPT, name + ": no WebP image, or a damaged one");
  }
  RgbaImage image;
  image.width = static_cast<uint32_t>(features.width);
  image.height = static_cast<uint32_t>(features.height);
  const uint64_t size = kChannels * image.pixels();
  const std::shared_ptr<void> decoder =
      hold(holder, kDecoderBytes * image.pixels() + kTableBytes, name);
  image.memory = hold(holder, size, name);
  image.rgba.resize(size);
  const int stride = static_cast<int>(kChannels * image.width);
  if (WebPDecodeRGBAInto(bytes.data(), bytes.size(), image.rgba.data(), image.rgba.size(),
                         stride) == nullptr) {
    throw Error(L4D_ERR_CORRUPT, name + ": the image is damaged, or ends early");
  }
  return image;
}

std::vector<uint8_t> encode_webp(const RgbaImage& image, const std::string& name) {
  constexpr int kEffort = 6;  // of 9
  WebPConfig config;
  WebPPicture picture;
  if (WebPConfigInit(&config) == 0 || WebPPictureInit(&picture) == 0 ||
      WebPConfigLosslessPreset(&config, kEffort) == 0) {
    throw Error(L4D_ERR_INTERNAL, name + ": the library for WebP is another one than expected");
  }
  const auto release = [](WebPPicture* p) { WebPPictureFree(p); };
  const std::unique_ptr<WebPPicture, decltype(release)> picture_memory(&picture, release);
  WebPMemoryWriter writer;
  WebPMemoryWriterInit(&writer);
  const auto clear = [](WebPMemoryWriter* w) { WebPMemoryWriterClear(w); };
  const std::unique_ptr<WebPMemoryWriter, decltype(clear)> writer_memory(&writer, clear);
  config.exact = 1;  // colours below alpha 0 are numbers, too
  picture.use_argb = 1;
  picture.width = static_cast<int>(image.width);
  picture.height = static_cast<int>(image.height);
  picture.writer = WebPMemoryWrite;
  picture.custom_ptr = &writer;
  const int stride = static_cast<int>(kChannels * image.width);
  if (WebPPictureImportRGBA(&picture, image.rgba.data(), stride) == 0 ||
      WebPEncode(&config, &picture) == 0) {
    throw Error(picture.error_code == VP8_ENC_ERROR_BAD_DIMENSION ? L4D_ERR_LIMIT_EXCEEDED
                                                                  : L4D_ERR_OUT_OF_MEMORY,
                name + ": cannot be written as WebP");
  }
  return {writer.mem, writer.mem + writer.size};
}

}  // namespace l4d::io
