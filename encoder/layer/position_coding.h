// SPDX-License-Identifier: Apache-2.0
// The frame that positions are coded in.
#pragma once

#include <vector>

#include "encoder/layer/coded_scene.h"
#include "encoder/plan/positions.h"
#include "encoder/prepare/scene.h"

namespace l4d {

// Fixed positions as a plan with bits says.
PositionCoding planned_positions(const PositionPlan& plan);

// As the plan says; what it leaves open follows from the positions of all layers. Fixed ones have a
// step of about that of the plan, or as fine as their bits allow.
PositionCoding choose_positions(const PositionPlan& plan, const std::vector<CodedLayer>& layers,
                                bool lossless);

// What coordinate k of Gaussian j is decoded to.
double coded_position(const PositionCoding& coding, const CodedLayer& layer, size_t j, size_t k);

}  // namespace l4d
