// SPDX-License-Identifier: Apache-2.0
#include "io/formats/instant_file.h"

#include <utility>

#include "io/formats/write_gltf.h"
#include "io/formats/write_sog.h"
#include "io/formats/write_spz.h"
#include "io/formats/write_usd.h"
#include "io/ply/scene_ply.h"

namespace l4d::io {
namespace {

WriteNotes write_ply(const std::string& path, Splats splats, const InstantSetting& setting) {
  write_3dgs_ply(path, splats, setting.check);
  return {};
}

WriteNotes write_compressed(const std::string& path, Splats splats, const InstantSetting& setting) {
  require_finite(splats, path);
  return write_compressed_ply(path, splats, setting.holder, setting.check);
}

struct InstantWriter {
  const char* extension;
  const char* loss;
  WriteNotes (*write)(const std::string& path, Splats splats, const InstantSetting& setting);
};
constexpr InstantWriter kWriters[] = {
    {".compressed.ply",
     "a compressed PLY shows one instant, in codes of 8 to 11 bits; clock and placement are not in "
     "it",
     write_compressed},
    {".ply", "a 3DGS PLY shows one instant, and states no clock and no placement", write_ply},
    {".glb", "glTF shows one instant; how the scene wants to be drawn is not in it", write_gltf},
    {".spz", "SPZ shows one instant, in steps of 8 bits; clock, origin and scale are not in it",
     write_spz},
    {".sog",
     "SOG shows one instant, in codes of 8 bits and a palette of spherical harmonics; clock, "
     "origin and scale are not in it",
     write_sog},
    {".usda", "USD shows one instant; how the scene wants to be drawn is not in it", write_usd}};

const InstantWriter& writer_of(const std::string& extension) {
  for (const InstantWriter& k : kWriters) {
    if (extension == k.extension) return k;
  }
  throw Error(L4D_ERR_INTERNAL, extension + " is no extension of an instant");
}

}  // namespace

std::vector<std::string> instant_extensions() {
  std::vector<std::string> extensions;
  for (const InstantWriter& k : kWriters) extensions.emplace_back(k.extension);
  return extensions;
}

std::string loss_of_instants(const std::string& extension) { return writer_of(extension).loss; }

WriteNotes write_instant_file(const std::string& path, const std::string& extension, Splats splats,
                              const InstantSetting& setting) {
  return writer_of(extension).write(path, std::move(splats), setting);
}

}  // namespace l4d::io
