// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "io/scene/rotor_math.h"
#include "io/scene/scene.h"

namespace l4d::io {

// The part of a scene that is meant to be looked at: a ball, scene units.
struct Subject {
  Vec3 center{};
  double radius = 1;
  // Of x, y, z the vertical one: y or z, whichever way the scene extends less (y where equal).
  size_t up_axis = 1;
  double up_sign = 1;  // which end of it is up: as the coordinates say, else +z or, of y, -y
};

// The ball around the bounds that the scene states, else the one that holds 90 % of the opacity of
// the dense parts: of floaters, and of scenery that is thinly covered, there is little there.
// Gaussians count where they are at the reference time. Throws Error(L4D_ERR_INVALID_SCENE) if none
// is visible.
Subject subject_of(const Scene& scene);

// Positions where Gaussians are seen, [N, 3]. Those of Gaussians whose mean time lies far outside
// the sequence can be far outside the scene.
std::vector<float> visible_positions(const Scene& scene);

}  // namespace l4d::io
