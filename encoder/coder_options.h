// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>

#include "encoder/nearest.h"
#include "encoder/settings.h"

namespace l4d {

// What the coders of attributes get besides the scene.
struct CoderOptions {
  const EncoderSettings* settings = nullptr;
  int threads = 0;
  NearestDevice* device = nullptr;
  uint64_t seed = 0;
  const std::function<bool()>* cancelled = nullptr;
  // Called before each component with its name.
  std::function<void(const char*)> step;
};

}  // namespace l4d
