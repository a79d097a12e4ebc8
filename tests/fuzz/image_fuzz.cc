// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>

#include "io/image/image.h"
#include "io/scene/scene.h"
#include "tests/fuzz/file_in_memory.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const l4d::fuzz::FileInMemory file(data, size);
  try {
    uint32_t pixels[2];
    // Larger images only measure the allocator.
    if (l4d::io::image_size(file.path(), pixels) && (pixels[0] > 255 || pixels[1] > 255)) return 0;
    const l4d::io::Image image = l4d::io::read_image(file.path());
    if (image.width == 0 || image.rgb.size() != size_t{3} * image.width * image.height) {
      std::abort();
    }
    for (const float v : image.rgb) {
      if (!(v >= 0 && v <= 1)) std::abort();
    }
  } catch (const l4d::io::Error& error) {
    if (error.status() == L4D_ERR_INTERNAL) std::abort();
  }
  return 0;
}
