// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "encoder/layer_coder.h"

namespace l4d {

// All that was coded of a scene.
struct CodedScene {
  CodedComponent sh;               // what all layers share of it: codebooks, or the basis
  std::vector<CodedLayer> layers;  // by level
};

}  // namespace l4d
