// SPDX-License-Identifier: Apache-2.0
// Tiers: the long-lived Gaussians cut by importance, so that players fetch what matters most first.
#pragma once

#include <vector>

#include "encoder/plan/layer_plan.h"
#include "encoder/prepare/scene.h"

namespace l4d {

// Cuts the layers of level 0 as the settings' tiers say; the order of layers stays. Layers of fewer
// than `least` Gaussians are not worth their tables: those Gaussians stay with the tier before. If
// the format does not allow so many layers, there are fewer tiers.
std::vector<LayerPlan> cut_into_tiers(const EncoderScene& scene, const EncoderSettings& settings,
                                      double least, std::vector<LayerPlan> plans);

}  // namespace l4d
