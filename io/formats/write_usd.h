// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "io/formats/instant.h"

namespace l4d::io {

// Writes the 3D Gaussians of an instant as the text form of OpenUSD (.usda): a prim of the schema
// ParticleField3DGaussianSplat, of version 26.03, with y up, the placement as its transform, and
// colours by which programs draw points that do not know the schema. Every number comes back as it
// was. Unknown axes are taken for those of USD.
WriteNotes write_usd(const std::string& path, Splats splats, const InstantSetting& setting);

}  // namespace l4d::io
