// SPDX-License-Identifier: Apache-2.0
// Seeded damage. Equal seeds give equal mutants.
#pragma once

#include "libl4dcodec/base/bytes.h"
#include "tests/common/random.h"

namespace l4d::test {

// Blind damage: flipped bits and bytes, runs of one byte, pieces copied or swapped, bytes removed
// or inserted, the end cut off.
void mutate_bytes(Bytes& bytes, Random& random);

// One of the numbers of a valid FlatBuffer set to something a parser may stumble over; false where
// there is none. `is_directory_page`: else a scene header.
bool mutate_flat(Bytes& bytes, bool is_directory_page, Random& random);

// A file with one to four of its numbers or chunks changed, sizes kept, and its checksums repaired.
void mutate_stream(Bytes& file, Random& random);

}  // namespace l4d::test
