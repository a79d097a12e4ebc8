// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "training/model/state.h"

namespace l4d::train {

constexpr uint64_t kMotionEvery = 500;  // steps from one renewal of motions to the next
constexpr size_t kMotionNeighbours = 8;

// The mean velocity of the nearest other rows of each row, in space and time: [count, 3] scene
// units a second. speed: scene units that count as far as a second.
std::vector<float> neighbour_motion(const ModelState& model, double speed);

}  // namespace l4d::train
