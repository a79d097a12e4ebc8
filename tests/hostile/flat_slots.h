// SPDX-License-Identifier: Apache-2.0
// Where the numbers of a serialised FlatBuffer lie: fields, elements of structs, offsets, lengths
// of vectors and entries of vtables. What a mutation has to know to change one thing at a time.
#pragma once

#include <vector>

#include "libl4dcodec/base/bytes.h"

namespace l4d::test {

struct FlatSlot {
  size_t offset;
  unsigned width;  // bytes: 1, 2, 4, 8
};

// Empty where the bytes are no valid FlatBuffer of their schema.
std::vector<FlatSlot> scene_header_slots(const Bytes& scene_header);
std::vector<FlatSlot> directory_page_slots(const Bytes& directory_page);

}  // namespace l4d::test
