// SPDX-License-Identifier: Apache-2.0
// An open stream: headers, and on demand directory pages, codebooks and block codebooks.
#pragma once

#include "decoder/read/chunk_reader.h"
#include "decoder/read/codebook_cache.h"
#include "decoder/read/directory_cache.h"
#include "l4d/decode.h"
#include "libl4dcodec/container/file_header.h"
#include "libl4dcodec/container/scene_header.h"

namespace l4d {

class SceneFile {
 public:
  // kernels: of the wanted backend. limits: options, of which only the limits count; resolved, no
  // zeros.
  SceneFile(ByteSource source, const l4d_decoder_options& limits, const StreamKernels& kernels);

  Status open();

  const FileHeader& file_header() const { return file_header_; }
  const SceneHeader& header() const { return header_; }
  ByteSource& source() { return reader_.source(); }
  const ByteSource& source() const { return reader_.source(); }
  MemoryBudget& memory() { return reader_.memory(); }
  const MemoryBudget& memory() const { return reader_.memory(); }
  DirectoryCache& directory() { return directory_; }
  CodebookCache& codebooks() { return codebooks_; }

  // Between queries: what has failed is tried again.
  void retry() { codebooks_.retry(); }
  // Between uses of what they hold, caches keep to their budgets.
  void trim();
  void begin_query();

  // Fixed bytes a layer refers to besides its pages and directory pages.
  uint64_t codebook_stored_bytes(uint32_t layer) const;

 private:
  l4d_decoder_options limits_;
  ChunkReader reader_;
  FileHeader file_header_;
  SceneHeader header_;
  DirectoryCache directory_;
  CodebookCache codebooks_;
};

}  // namespace l4d
