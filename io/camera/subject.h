// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "io/scene/rotor_math.h"
#include "io/scene/scene.h"

namespace l4d::io {

// The part of a scene that is meant to be looked at: a ball, scene units.
struct Subject {
  Vec3 center{};
  double radius = 1;
  Vec3 up{0, -1, 0};
};

// The ball around the bounds that the scene states, else the one that holds 90 % of the opacity of
// the dense parts: of floaters, and of scenery that is thinly covered, there is little there. In a
// scene that is mostly at rest they are those of what moves or does not last.
// Gaussians count where they are at the reference time. Up is +y or -y where the scene states its
// coordinates; else the end of the y or z axis away from the foot: what stands is broad there.
// Where neither axis has one it is -y, as structure from motion has it. Throws
// Error(L4D_ERR_INVALID_SCENE) if none is visible.
Subject subject_of(const Scene& scene);

// The same, whatever moves: cameras around the one who moves would stand in the midst of the rest.
Subject whole_subject_of(const Scene& scene);

// What they and SightGrid take while they look at a scene, at most.
uint64_t subject_bytes(const Scene& scene);

// The share of the sequence that the flat window of Gaussian i has; 1 without one. What frames make
// anew each time is many Gaussians, of which one shows at a time.
double window_share(const Scene& scene, size_t i);

// Of the broadest side of Gaussian i, square scene units; 0 where it is absurd or
// the scene has no scales.
double area_of(const Scene& scene, size_t i);

// Positions where Gaussians are seen, [N, 3]. Those of Gaussians whose mean time lies far outside
// the sequence can be far outside the scene.
std::vector<float> visible_positions(const Scene& scene);

}  // namespace l4d::io
