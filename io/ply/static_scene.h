// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "io/ply/scene_ply.h"

namespace l4d::io {

// Gaussians of a format without time, as it has them.
struct StaticRows {
  uint32_t sh_degree = 0;
  std::vector<float> position;   // [N, 3]
  std::vector<float> log_scale;  // [N, 3]
  std::vector<float> rotation;   // [N, 4] w x y z, of any length
  std::vector<float> opacity;    // [N] in [0, 1]
  std::vector<float> sh;         // [N, (D+1)^2, 3]

  StaticRows(size_t count, uint32_t degree)
      : sh_degree(degree),
        position(3 * count),
        log_scale(3 * count),
        rotation(4 * count),
        opacity(count),
        sh(count * 3 * (degree + 1) * (degree + 1)) {}
};

// Bytes that the rows and their scene take together.
uint64_t static_scene_bytes(uint64_t count, uint32_t sh_degree);

// The scene in which they last, as one of a 3DGS PLY does.
Scene static_scene(StaticRows rows, const char* source, const ImportOptions& options);

}  // namespace l4d::io
