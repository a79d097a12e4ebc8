// SPDX-License-Identifier: Apache-2.0
// Scenes that a coder which is good on average is bad at.
#pragma once

#include <vector>

#include "tests/common/test_scene.h"

namespace l4d::numerics {

struct HardScene {
  const char* name;
  const char* what;
  test::TestScene (*make)();
};

const std::vector<HardScene>& hard_scenes();

// A static room with `floaters` far out, the last Gaussians of the scene.
test::TestScene room_with_floaters(double distance, size_t floaters);

}  // namespace l4d::numerics
