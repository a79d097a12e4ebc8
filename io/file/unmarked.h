// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

namespace l4d::io {

// Files that do not begin with a name of their format, known by what their first bytes hold.
// head: those bytes, the more the better; size: of the file.

// Records of SPLAT: finite positions, sizes of 0 or more, quaternions of length 1.
bool looks_like_splat(std::string_view head, uint64_t size);

// The header of KSPLAT: a version, and zeros behind the fields that it has.
bool looks_like_ksplat(std::string_view head, uint64_t size);

// Whether `head` is the begin of a gzip file whose content begins with `magic`.
bool is_gzip_of(std::string_view head, std::string_view magic);

}  // namespace l4d::io
