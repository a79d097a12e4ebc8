// SPDX-License-Identifier: Apache-2.0
// Which layer each Gaussian belongs to, from its temporal extent (spec: "Layers and buckets").
#pragma once

#include <vector>

#include "encoder/plan/layer_plan.h"
#include "encoder/prepare/scene.h"

namespace l4d {

// Layers by ascending level, the permanent one first; thin finest layers merged into coarser ones.
// Gaussians with flat windows have layers of their own, by level among the others.
// Level 0 is always there, possibly empty: its first tier takes what fits nowhere else. A layer is
// not merged where that would leave a mean time less exact than the quality asks for.
std::vector<LayerPlan> plan_layers(const EncoderScene& scene, const EncoderSettings& settings);

}  // namespace l4d
