// SPDX-License-Identifier: Apache-2.0
// Scene PLY files: l4d_ply, .ftgs.ply, SpacetimeGaussians and 3DGS, told apart by their headers.
#include <cstdlib>

#include "io/ply/scene_ply.h"
#include "tests/fuzz/file_in_memory.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const l4d::fuzz::FileInMemory file(data, size);
  try {
    const l4d::io::Scene scene = l4d::io::read_scene_ply(file.path());
    const size_t n = scene.count();
    if (scene.sh_degree > 3 || scene.position.size() != 3 * n || scene.rotor.size() != 8 * n ||
        scene.sh.size() != 3 * scene.sh_coefficients() * n || scene.timeline.num_frames == 0 ||
        scene.timeline.fps_num == 0 || scene.timeline.fps_den == 0) {
      std::abort();
    }
  } catch (const l4d::io::Error& error) {
    if (error.status() == L4D_ERR_INTERNAL) std::abort();
  }
  return 0;
}
