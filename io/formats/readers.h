// SPDX-License-Identifier: Apache-2.0
// The readers that read_scene_file() chooses between. Each checks counts against the bytes of the
// file before it allocates memory, counts that memory with the holder, and throws Error.
#pragma once

#include "io/file/file.h"
#include "io/ply/scene_ply.h"

namespace l4d::io {

// The arrays that `decode --format raw` writes, with what the scene states of itself.
Scene read_raw(InputFile file, const ImportOptions& options);
Scene read_spz(InputFile file, const ImportOptions& options);
Scene read_sog(InputFile file, const ImportOptions& options);
Scene read_ksplat(InputFile file, const ImportOptions& options);
Scene read_4dgs(InputFile file, const ImportOptions& options);
Scene read_splatv(InputFile file, const ImportOptions& options);
Scene read_splat(InputFile file, const ImportOptions& options);
Scene read_gltf(InputFile file, const ImportOptions& options);

}  // namespace l4d::io
