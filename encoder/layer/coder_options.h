// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>

#include "encoder/prepare/error_bounds.h"
#include "encoder/prepare/settings.h"
#include "encoder/search/nearest.h"
#include "libl4dcodec/container/scene_header.h"

namespace l4d {

// Thrown out of the innermost loops; caught in Encoder::encode.
struct Cancelled {};

// What the coders of attributes get besides the scene.
struct CoderOptions {
  const EncoderSettings* settings = nullptr;
  ErrorBounds bounds;  // none, but for what settings and scene declare
  // Says how positions are rounded; null where that is not known yet.
  const PositionCoding* positions = nullptr;
  int threads = 0;
  NearestDevice* device = nullptr;
  uint64_t seed = 0;
  // Whether to end early; asked on any thread.
  const std::function<bool()>* cancelled = nullptr;
  // Called before each component with its name, and where it is waited for.
  std::function<void(const char*)> step;
};

}  // namespace l4d
