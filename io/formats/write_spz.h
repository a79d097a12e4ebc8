// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "io/formats/instant.h"

namespace l4d::io {

// Writes the 3D Gaussians of an instant as SPZ 4. Positions get as many fractional bits as fit into
// 24, 16 at most; spherical harmonics all 8 bits. Fails with L4D_ERR_LIMIT_EXCEEDED where the
// format does not hold the positions or the number of Gaussians.
WriteNotes write_spz(const std::string& path, Splats splats, const InstantSetting& setting);

}  // namespace l4d::io
