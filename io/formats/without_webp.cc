// SPDX-License-Identifier: Apache-2.0
// Takes the place of webp.cc in a build without libwebp.
#include "io/formats/webp.h"
#include "io/scene/scene.h"

namespace l4d::io {
namespace {

[[noreturn]] void refuse(const std::string& name) {
  throw Error(
      L4D_ERR_FEATURE_UNSUPPORTED,
      name +
          ": its images are WebP, and the tool was built without libwebp (libwebp-dev, "
          "-DL4D_WEBP=ON); `npx @playcanvas/splat-transform` converts SOG files from and to PLY");
}

}  // namespace

RgbaImage decode_webp(const std::vector<uint8_t>& /*bytes*/, const std::string& name,
                      const Hold& /*holder*/) {
  refuse(name);
}

std::vector<uint8_t> encode_webp(const RgbaImage& /*image*/, const std::string& name) {
  refuse(name);
}

}  // namespace l4d::io
