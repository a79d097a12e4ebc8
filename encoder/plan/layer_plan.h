// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

namespace l4d {

// The Gaussians of a layer.
struct LayerPlan {
  unsigned level = 0;
  bool permanent = false;
  bool far = false;   // level 0: mean times far outside the sequence
  bool flat = false;  // of Gaussians with flat windows
  unsigned tier = 0;
  std::vector<uint32_t> gaussians;  // indices in the scene, ascending
};

}  // namespace l4d
