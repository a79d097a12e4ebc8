// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <utility>

#include "decoder/read/source.h"
#include "libl4dcodec/base/memory.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/entropy/stream.h"

namespace l4d {

// Reads chunks of a stream, within its limit of memory.
class ChunkReader {
 public:
  ChunkReader(ByteSource source, uint64_t max_memory_bytes, const StreamKernels& kernels)
      : source_(std::move(source)) {
    decoder_.kernels = &kernels;
    memory_.set_limit(max_memory_bytes);
  }
  ChunkReader(const ChunkReader&) = delete;
  ChunkReader& operator=(const ChunkReader&) = delete;

  // Reads a chunk, checks its hash and undoes its codec. *raw aliases the source or `storage`.
  Status read(const ChunkRef& chunk, uint64_t max_raw_bytes, Bytes& stored, Bytes& storage,
              ByteSpan* raw);

  ByteSource& source() { return source_; }
  const ByteSource& source() const { return source_; }
  MemoryBudget& memory() { return memory_; }
  const MemoryBudget& memory() const { return memory_; }
  StreamDecoder& decoder() { return decoder_; }

 private:
  MemoryBudget memory_;  // outlives the source, which charges what it fetches
  ByteSource source_;
  StreamDecoder decoder_;
};

}  // namespace l4d
