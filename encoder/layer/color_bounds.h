// SPDX-License-Identifier: Apache-2.0
// The bounds on the colours of single Gaussians, which the coders of SH keep row by row.
#pragma once

#include "encoder/component/coded_component.h"
#include "encoder/prepare/scene.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/scene/color_errors.h"

namespace l4d {

// Whether SH of the scene may be decoded so; empty if nothing bounds colours. It refers to the
// scene.
RowCheck color_check(const EncoderScene& scene, const ErrorBounds& bounds);

// The largest errors over all Gaussians of the scene, whose SH is coded.
ColorErrors largest_color_errors(const EncoderScene& scene, const CodedComponent& sh, int threads);

// Fails with INVALID_SCENE if an error is beyond its bound: SH that no code of the format comes
// near enough to.
Status check_colors(const ColorErrors& errors, const ErrorBounds& bounds);

}  // namespace l4d
