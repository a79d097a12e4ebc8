// SPDX-License-Identifier: Apache-2.0
// The last check of what was coded: every Gaussian, as a decoder will have it, against the scene.
#pragma once

#include <vector>

#include "encoder/layer_coder.h"

namespace l4d {

// The largest errors of all members of the layers, with positions and opacities coded so.
// bounds: what sizes count; its slacks do not.
GaussianErrors observed_errors(const EncoderScene& scene, const PositionCoding& positions,
                               const ScalarCoding& opacity, const std::vector<CodedLayer>& layers,
                               ErrorBounds bounds, int threads);

// What the header says of them, with the bounds. Rounded up: no error is beyond what is stated.
ErrorStatement statement_of(const GaussianErrors& errors, const ErrorBounds& bounds);

}  // namespace l4d
