// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/chunk_reader.h"

#include <algorithm>

#include "libl4dcodec/base/hash.h"

namespace l4d {

Status ChunkReader::read(const ChunkRef& chunk, uint64_t max_raw_bytes, Bytes& stored,
                         Bytes& storage, ByteSpan* raw) {
  // The buffers are short-lived, but their sizes come from the file.
  MemoryCharge scratch(memory_);
  L4D_RETURN_IF_ERROR(scratch.take(
      chunk.stored_bytes + std::min<uint64_t>(chunk.raw_bytes, max_raw_bytes), "a chunk"));
  ByteSpan bytes;
  L4D_RETURN_IF_ERROR(source_.read(chunk.offset, chunk.stored_bytes, stored, &bytes));
  if (hash64(bytes) != chunk.hash) {
    return source_.after_check(
        Status(L4D_ERR_CHECKSUM, "CHNK-2", chunk.offset, "checksum of a chunk does not match"));
  }
  return decode_chunk(decoder_, chunk.codec, bytes, chunk.raw_bytes, max_raw_bytes, chunk.offset,
                      storage, raw);
}

}  // namespace l4d
