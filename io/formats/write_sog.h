// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "io/formats/instant.h"

namespace l4d::io {

// Writes the 3D Gaussians of an instant as SOG 2, in the order of a curve through space, by which
// images of them compress better. Axes stay as they are, as in a 3DGS PLY. Spherical harmonics get
// a palette of at most 65536 rows. Fails with L4D_ERR_FEATURE_UNSUPPORTED in a build without
// libwebp, and with L4D_ERR_INVALID_SCENE if there is no Gaussian.
WriteNotes write_sog(const std::string& path, Splats splats, const InstantSetting& setting);

}  // namespace l4d::io
