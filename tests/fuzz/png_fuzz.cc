// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>

#include "io/image/image.h"
#include "io/scene/scene.h"
#include "tests/fuzz/file_in_memory.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  // Sizes of the first chunk up to 256: larger images only measure the allocator.
  if (size >= 24 && (data[16] != 0 || data[17] != 0 || data[18] != 0 || data[20] != 0 ||
                     data[21] != 0 || data[22] != 0)) {
    return 0;
  }
  const l4d::fuzz::FileInMemory file(data, size);
  try {
    const l4d::io::Image image = l4d::io::read_png(file.path());
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
