// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "flatbuffers/minireflect.h"
#include "libl4dcodec/base/span.h"

namespace l4d {

// What flatbuffers::Verifier leaves open of a buffer that it has accepted (spec: HEAD-1): whether
// each vtable has room for its two sizes, each table lies in the buffer, and each field lies in its
// table, aligned. bytes: at an address that is a multiple of 8.
bool tables_are_whole(ByteSpan bytes, const flatbuffers::TypeTable* root);

}  // namespace l4d
