// SPDX-License-Identifier: Apache-2.0
// The last check of what was coded: every Gaussian, as a decoder will have it, against the scene.
#pragma once

#include <vector>

#include "encoder/layer/coded_scene.h"
#include "encoder/prepare/scene.h"

namespace l4d {

// A Gaussian as a decoder will have it, bit for bit.
struct DecodedGaussian {
  float position[3];
  double mean_t;  // seconds
  float log_scale[4], rotor[8], opacity;
};

// Member j of a layer, with positions and opacities coded so; not of lossless streams.
DecodedGaussian decoded_gaussian(const EncoderScene& scene, const PositionCoding& positions,
                                 const ScalarCoding& opacity, const CodedLayer& layer, size_t j);

// What was to be coded, or the scene that it was fitted to.
enum class ErrorsAgainst { kCoded, kScene };

// The largest errors of all Gaussians of the layers, with positions and opacities coded so.
// bounds: what sizes count; its slacks do not.
GaussianErrors observed_errors(const EncoderScene& scene, const PositionCoding& positions,
                               const ScalarCoding& opacity, const std::vector<CodedLayer>& layers,
                               ErrorBounds bounds, int threads,
                               ErrorsAgainst against = ErrorsAgainst::kCoded);

// Fails with INVALID_SCENE, the parameter and the way out if an error is above its bound.
Status check_bounds(const GaussianErrors& worst, const ErrorBounds& bounds);

// What the header says of them, with the bounds that they keep. Rounded up: no error is beyond what
// is stated, and none that is stated is above its bound.
ErrorStatement statement_of(const GaussianErrors& errors, const ErrorBounds& bounds);

}  // namespace l4d
