// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "encoder/component/coded_component.h"
#include "encoder/layer/coder_options.h"
#include "encoder/prepare/scene.h"

namespace l4d {

// The SH coefficients of the whole scene, as a transform or in codebooks, which are ranked.
CodedComponent code_sh(const EncoderScene& scene, const CoderOptions& options);

}  // namespace l4d
