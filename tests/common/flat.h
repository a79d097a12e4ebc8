// SPDX-License-Identifier: Apache-2.0
// Edits of serialised FlatBuffers that no builder would make: fields the library never writes,
// tables and strings used twice.
#pragma once

#include "libl4dcodec/base/bytes.h"

namespace l4d::test {

// A scene header with one extension more.
void add_extension(Bytes& scene_header, uint32_t id, bool critical);

// Makes every entry of the metadata refer to the first one.
void share_metadata(Bytes& scene_header);

// Gives the second table of a block of a directory page the component of the first.
void repeat_component(Bytes& directory_page, size_t block);

// Where a vtable begins: of the table of the opacity's coding in a scene header, and of the root
// table of any FlatBuffer.
size_t opacity_vtable(const Bytes& scene_header);
size_t root_vtable(const Bytes& buffer);

}  // namespace l4d::test
