// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "io/ply/scene_ply.h"

namespace l4d::io {

// Whether read_scene_file() has a reader for the file at `path`, by its first bytes or, where these
// say nothing, by the extension of `name`. Throws Error(L4D_ERR_IO).
bool is_scene_file(const std::string& path, const std::string& name);

// Whether the name ends as those of list_of_scene_files() do.
bool has_scene_name(const std::string& name);

// Why nothing reads the file, if it is known to be of another program, or a web page; else "". It
// goes on behind the file's name.
std::string foreign_refusal(const std::string& path, const std::string& name);

// Extensions of files that read_scene_file() reads, with a comma between them, a PLY first.
std::string list_of_scene_files();

// Reads a scene of any format that docs/formats.md lists as read, but for streams. Throws Error:
// L4D_ERR_IO, L4D_ERR_CORRUPT, L4D_ERR_FEATURE_UNSUPPORTED, L4D_ERR_LIMIT_EXCEEDED.
Scene read_scene_file(const std::string& path, const std::string& name,
                      const ImportOptions& options = {});

// A sentence for each option that was given and that changed nothing of a scene which was read with
// them, be it a stream ("l4d"): it states what they are for, or has no use for it.
std::vector<std::string> unused_options(const ImportOptions& options, const l4d_timeline& timeline,
                                        const std::string& source);

}  // namespace l4d::io
