// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

namespace l4d::io {

// A kind of file that is neither a stream nor a PLY. io/formats/scene_file.cc reads some of them.
struct FileKind {
  std::string name;       // "an SPZ file"
  std::string way;        // what a person does with one who wants a scene of it
  std::string extension;  // of the kind: ".spz"
};

// The extension of a name in lower case, as ".spz"; "" if it has none.
std::string lower_extension(const std::string& name);

// By an extension in lower case, as ".spz"; nothing if it is none that is known.
std::optional<FileKind> kind_of_extension(const std::string& extension);

// Whether the file begins as a PLY does. Throws Error(L4D_ERR_IO).
bool is_ply(const std::string& path);
// The same of a stream.
bool is_stream(const std::string& path);

// What the file at `path` is by its first bytes, or where these say nothing by the extension of
// `name`. Nothing if it may be a stream or a scene, or is unknown. Throws Error(L4D_ERR_IO).
std::optional<FileKind> identify_file(const std::string& path, const std::string& name);

}  // namespace l4d::io
