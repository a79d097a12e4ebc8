// SPDX-License-Identifier: Apache-2.0
// How finely positions and opacities are coded, decided before any layer is: what follows has to
// allow for it.
#pragma once

#include <cstdint>
#include <vector>

#include "encoder/prepare/error_bounds.h"
#include "encoder/prepare/quality.h"
#include "encoder/prepare/scene.h"

namespace l4d {

struct PositionPlan {
  double step = 0;  // of fixed positions, scene units; 0 = binary16
  // With bounds on them: where coordinates count from, so that it is known how each will be
  // rounded, and their bits. 0 = both follow from what is coded.
  float center[3] = {0, 0, 0};
  unsigned bits = 0;
  // Gaussians so far out that coordinates of this step do not reach them (ascending): a few
  // floaters must not coarsen the positions of all others.
  std::vector<uint32_t> out_of_reach;
  unsigned opacity_bits = 0;
};

// Bounds as the settings declare them, with the size below which errors do not count.
ErrorBounds declared_bounds(const EncoderScene& scene, const EncoderSettings& settings);

// Sets the slacks of the bounds. Not for lossless scenes.
PositionPlan plan_positions(const EncoderScene& scene, const EncoderSettings& settings,
                            const Quality& quality, ErrorBounds* bounds);

}  // namespace l4d
