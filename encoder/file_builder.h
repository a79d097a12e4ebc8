// SPDX-License-Identifier: Apache-2.0
// Coded layers to the bytes of a file: codebooks, directory, payload in time order, header.
#pragma once

#include <vector>

#include "encoder/page_builder.h"

namespace l4d {

struct FileParts {
  std::vector<Bytes> chunks;    // in file order, the file header first
  std::vector<uint32_t> order;  // input index of each Gaussian in decoded order
  uint64_t bytes = 0;
};

// header: scene-wide fields set, layers empty. `sh` is the scene's SH component (indexed by scene
// index), unused where the scene is lossless.
// Fails with LIMIT_EXCEEDED where the file goes beyond the conformance level that it shall declare.
Status build_file(const EncoderScene& scene, const EncoderSettings& settings, SceneHeader header,
                  const std::vector<CodedLayer>& layers, const CodedComponent& sh, int threads,
                  FileParts* out);

}  // namespace l4d
