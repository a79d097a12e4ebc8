// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "io/formats/instant.h"

namespace l4d::io {

// Extensions of the formats that hold the 3D Gaussians of one instant, in lower case, the longer of
// two that end alike first.
std::vector<std::string> instant_extensions();

// What the format of this extension never holds of a scene: "glTF shows one instant; ...".
std::string loss_of_instants(const std::string& extension);

// Writes the Gaussians of an instant in the format of this extension, one of the above, under a
// temporary name that becomes `path` on success. Throws Error.
WriteNotes write_instant_file(const std::string& path, const std::string& extension, Splats splats,
                              const InstantSetting& setting);

}  // namespace l4d::io
