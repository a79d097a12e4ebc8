// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "io/formats/instant.h"

namespace l4d::io {

// Writes the 3D Gaussians of an instant as binary glTF 2.0 (.glb) with KHR_gaussian_splatting, and
// colours by which other viewers draw points. The node has what turns the coordinates of the
// placement into those of glTF; unknown ones are taken for those of glTF. Fails with
// L4D_ERR_LIMIT_EXCEEDED if the arrays take 4 GB or more.
WriteNotes write_gltf(const std::string& path, Splats splats, const InstantSetting& setting);

}  // namespace l4d::io
