// SPDX-License-Identifier: Apache-2.0
// One layer from Gaussians to codes, as a decoder will see it.
#pragma once

#include <cstdint>
#include <vector>

#include "encoder/layer/coded_scene.h"
#include "encoder/layer/coder_options.h"
#include "encoder/plan/layer_plan.h"
#include "encoder/prepare/scene.h"

namespace l4d {

// Codes the Gaussians of a plan. Those whose decoded form no longer fits the layer are left out and
// returned in `demoted` (ascending) for the next coarser layer. Those that no code brings within
// options.bounds are left out too and added to `escapes`, unless that is null.
CodedLayer code_layer(const EncoderScene& scene, const LayerPlan& plan, const CoderOptions& options,
                      std::vector<uint32_t>* demoted, std::vector<uint32_t>* escapes);

// A layer that holds its Gaussians, whose extents its level allows, as they are. (Of a
// coarser one, times from the middle of its buckets would be rounded more than brief ones bear.)
CodedLayer code_escapes(const EncoderScene& scene, unsigned level, bool flat,
                        const std::vector<uint32_t>& gaussians);

}  // namespace l4d
