// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "io/formats/instant.h"

namespace l4d::io {

// Writes the whole scene as .4dgs, version 1, under a temporary name that becomes `path` on
// success. What it rounds to is in docs/formats.md. Throws Error.
// Memory that write_4dgs takes beside the scene, at most.
uint64_t bytes_to_write_4dgs(const Scene& scene);
WriteNotes write_4dgs(const std::string& path, const Scene& scene, const Check& check = {});

}  // namespace l4d::io
