// SPDX-License-Identifier: Apache-2.0
// cameras.json, transforms.json and poses_bounds.npy, told apart by what they hold.
#include <cmath>
#include <cstdlib>

#include "io/camera/cameras.h"
#include "io/scene/scene.h"
#include "tests/fuzz/file_in_memory.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const l4d::fuzz::FileInMemory file(data, size);
  try {
    const l4d::io::CameraSet set = l4d::io::read_cameras(file.path());
    for (const l4d::io::Camera& c : set.cameras) {
      if (c.camera.width == 0 || c.camera.height == 0 || c.camera.width > 16384 ||
          c.camera.height > 16384 || !(c.camera.fx > 0) || !std::isfinite(c.camera.fx)) {
        std::abort();
      }
    }
    const l4d_timeline timeline{0, 100, 30, 1, 0};
    (void)l4d::io::select_views(set, {"all", "", "0:40:4"}, timeline);
  } catch (const l4d::io::Error& error) {
    if (error.status() == L4D_ERR_INTERNAL) std::abort();
  }
  return 0;
}
