// SPDX-License-Identifier: Apache-2.0
// Scales and rotors of a layer: which coding each gets, and what that decodes to.
#pragma once

#include "encoder/layer_coder.h"
#include "encoder/quality.h"

namespace l4d {

// Codes the scales and rotors of layer->members, whose buckets and blocks are there. Fills factor,
// component and, of the header, what says how they are coded but for describe_component.
void code_shapes(const EncoderScene& scene, const CoderOptions& options, const Quality& quality,
                 CodedLayer* layer);

// Member j as a decoder will have it: rotor [8], log_scale [4].
void decoded_shape(const CodedLayer& layer, size_t j, float* rotor, float* log_scale);

}  // namespace l4d
