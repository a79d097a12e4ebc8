// SPDX-License-Identifier: Apache-2.0
// Finds the chunks of a file, sound or damaged, by its own references, and repairs their checksums:
// what a decoder does behind a checksum can be tested only where the checksum is right.
#pragma once

#include <cstdint>
#include <vector>

#include "libl4dcodec/base/bytes.h"

namespace l4d::test {

enum class ChunkKind {
  kFileHeader,
  kSceneHeader,
  kCodebook,
  kPageTable,
  kDirectoryPage,
  kBlockCodebook,
  kPage,
  kShDetail
};

struct ChunkPlace {
  ChunkKind kind;
  size_t offset;
  size_t bytes;
};

// Every range inside the file that something refers to; goes no further where references break off.
std::vector<ChunkPlace> chunk_places(const Bytes& file);

// Makes the hash of every chunk that chunk_places() would list right, those of chunks inside
// directory pages under a codec excepted.
void repair_checksums(Bytes& file);

}  // namespace l4d::test
