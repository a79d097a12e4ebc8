// SPDX-License-Identifier: Apache-2.0
// Coded layers to the bytes of a file: codebooks, directory, payload in time order, header.
#pragma once

#include <functional>
#include <vector>

#include "encoder/file/page_builder.h"
#include "encoder/layer/coded_scene.h"
#include "encoder/prepare/scene.h"
#include "encoder/prepare/settings.h"

namespace l4d {

struct FileParts {
  std::vector<Bytes> chunks;    // in file order, the file header first
  std::vector<uint32_t> order;  // input index of each Gaussian in decoded order
  uint64_t bytes = 0;
};

// header: as choose_header chose it. What only chunks tell is added: where each lies, which layers
// have entropy tables, and the profile and level that the stream keeps to, unless settings say.
// cancelled: asked on any thread; then throws Cancelled.
// Fails with LIMIT_EXCEEDED where the file goes beyond the conformance level that it shall declare.
Status build_file(const EncoderScene& scene, const EncoderSettings& settings, SceneHeader header,
                  const CodedScene& coded, int threads, FileParts* out,
                  const std::function<bool()>* cancelled = nullptr);

}  // namespace l4d
