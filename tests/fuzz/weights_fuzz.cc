// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>

#include "io/ply/weights.h"
#include "io/scene/scene.h"
#include "tests/fuzz/file_in_memory.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const l4d::fuzz::FileInMemory file(data, size);
  try {
    const l4d::io::Weights weights = l4d::io::read_weights_ply(file.path());
    for (const auto* column : {&weights.alpha_t, &weights.sh, &weights.scale,
                               &weights.rotor_spatial, &weights.rotor_temporal}) {
      if (!column->empty() && column->size() != weights.count) std::abort();
      for (const float v : *column) {
        if (!(v >= 0)) std::abort();
      }
    }
  } catch (const l4d::io::Error& error) {
    if (error.status() == L4D_ERR_INTERNAL) std::abort();
  }
  return 0;
}
