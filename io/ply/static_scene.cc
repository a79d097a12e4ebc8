// SPDX-License-Identifier: Apache-2.0
#include "io/ply/static_scene.h"

#include "io/ply/read_ply.h"

namespace l4d::io {

uint64_t static_scene_bytes(uint64_t count, uint32_t sh_degree) {
  return count * 2 * numbers_per_gaussian(sh_degree) * sizeof(float);
}

Scene static_scene(StaticRows rows, const char* source, const ImportOptions& options) {
  Scene scene;
  scene.source = source;
  scene.sh_degree = rows.sh_degree;
  set_default_timeline(scene, options);
  const size_t count = rows.opacity.size();
  scene.resize(count);
  scene.position = std::move(rows.position);
  scene.opacity = std::move(rows.opacity);
  scene.sh = std::move(rows.sh);
  for (size_t i = 0; i < count; ++i) {
    for (size_t k = 0; k < 3; ++k) scene.log_scale[4 * i + k] = rows.log_scale[3 * i + k];
  }
  make_static(rows.rotation, scene);
  return scene;
}

}  // namespace l4d::io
