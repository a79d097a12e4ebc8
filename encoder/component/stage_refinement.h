// SPDX-License-Identifier: Apache-2.0
// Joint refinement of residual stages: coded one after another, each stage knows nothing of those
// that follow. Here every stage is coded again for what all others leave to it.
#pragma once

#include "encoder/component/coded_component.h"

namespace l4d {

// Where bits have a price, codewords become multiples of a step that follows from it.
//
// Codewords move and Gaussians change codewords, depths stay. Does nothing to one stage alone
// without a price of bits, and nothing where blocks have codebooks of their own: those were made
// for the codewords they refer to.
void refine_stages(const float* rows, const float* weights, const ComponentSettings& settings,
                   CodedVq* component);

}  // namespace l4d
