// SPDX-License-Identifier: Apache-2.0
// .splat: 32 bytes a Gaussian, without a header.
#include <algorithm>
#include <cmath>

#include "io/file/little_endian.h"
#include "io/formats/inflate.h"
#include "io/formats/readers.h"
#include "io/ply/static_scene.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

constexpr size_t kSplatBytes =
    32;  // x y z and three scales of 4 bytes, r g b a, and a quaternion w x y z

}  // namespace

Scene read_splat(InputFile input, const ImportOptions& options) {
  const std::string path = input.path();
  std::shared_ptr<void> file_memory;
  const std::vector<uint8_t> file = read_counted(&input, options.holder, &file_memory);
  if (file.size() % kSplatBytes != 0) {
    throw Error(L4D_ERR_CORRUPT, path + ": " + std::to_string(file.size()) +
                                     " bytes are no multiple of 32, which a Gaussian takes");
  }
  const size_t stored = file.size() / kSplatBytes;
  std::vector<const uint8_t*> records;
  for (size_t i = 0; i < stored; ++i) {
    const uint8_t* record = &file[kSplatBytes * i];
    if (std::any_of(record, record + kSplatBytes, [](uint8_t b) { return b != 0; })) {
      records.push_back(record);
    }
  }
  const size_t count = records.size();
  std::shared_ptr<void> memory =
      hold(options.holder, static_scene_bytes(count, 0) + stored * sizeof(records[0]), path);
  StaticRows rows(count, 0);
  for (size_t i = 0; i < count; ++i) {
    const uint8_t* row = records[i];
    for (size_t k = 0; k < 3; ++k) {
      rows.position[3 * i + k] = little_endian_float(row + 4 * k);
      const float scale = little_endian_float(row + 12 + 4 * k);
      if (scale < 0) {
        throw Error(L4D_ERR_INVALID_SCENE, path + ": Gaussian " + std::to_string(i) +
                                               " has a scale below 0, which is no length");
      }
      rows.log_scale[3 * i + k] = static_cast<float>(std::log(static_cast<double>(scale)));
      rows.sh[3 * i + k] = static_cast<float>((row[24 + k] / 255.0 - 0.5) / sh_constant::k0);
    }
    rows.opacity[i] = static_cast<float>(row[27] / 255.0);
    for (size_t k = 0; k < 4; ++k) {
      rows.rotation[4 * i + k] = static_cast<float>((row[28 + k] - 128.0) / 128);
    }
  }
  Scene scene = static_scene(std::move(rows), "splat", options);
  if (count < stored) scene.notes.push_back(zeros_note(stored - count, stored));
  scene.memory = std::move(memory);
  return scene;
}

}  // namespace l4d::io
