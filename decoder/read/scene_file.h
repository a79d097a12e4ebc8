// SPDX-License-Identifier: Apache-2.0
// An open stream: headers, and on demand directory pages, codebooks and block codebooks.
#pragma once

#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "decoder/read/source.h"
#include "libl4dcodec/base/memory.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/file_header.h"
#include "libl4dcodec/container/planes.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/entropy/stream.h"
#include "libl4dcodec/quant/codebook.h"

namespace l4d {

class SceneFile {
 public:
  // kernels: of the wanted backend. limits: resolved, no zeros.
  SceneFile(ByteSource source, const l4d_limits& limits, const StreamKernels& kernels);

  Status open();

  const FileHeader& file_header() const { return file_header_; }
  const SceneHeader& header() const { return header_; }
  ByteSource& source() { return source_; }
  const ByteSource& source() const { return source_; }
  MemoryBudget& memory() { return memory_; }
  const MemoryBudget& memory() const { return memory_; }

  // Reads a chunk, checks its hash and undoes its codec. *raw aliases the source or `storage`.
  Status read_chunk(const ChunkRef& chunk, uint64_t max_raw_bytes, Bytes& stored, Bytes& storage,
                    ByteSpan* raw);

  // The directory pages [first, last] of a layer, in order; null where no bucket of one holds
  // Gaussians. Pointers live until the next trim().
  Status directory_pages(uint32_t layer, uint32_t first, uint32_t last,
                         std::vector<const DirectoryPage*>* out);
  // Stored bytes of page table entry and page.
  uint64_t directory_bytes(uint32_t layer, uint32_t index) const;

  // The codebook of a stage, of the residual codebook (stage = kRcqStage), or of a block. Pointers
  // to block codebooks live until the next trim(), the others as long as this object.
  static constexpr unsigned kRcqStage = L4D_MAX_STAGES;
  Status codebook(uint32_t layer, unsigned component, unsigned stage, const CodebookData** out);
  Status block_codebook(uint32_t layer, unsigned component, uint32_t directory_index,
                        uint32_t block, const CodebookData** out);

  // Tables of the layer's rans32 pages; they live as long as this object.
  Status entropy_tables(uint32_t layer, const EntropyTables** out);

  // Drops cached directory pages and block codebooks beyond a budget: what a long playback has
  // passed. Called between queries.
  void trim();

  // A codebook that cannot be read fails at once when it is asked for again, since every page of
  // its layer does, until this is called.
  void retry() { failed_books_.clear(); }

  // Fixed bytes a layer refers to besides its pages and directory pages.
  uint64_t codebook_stored_bytes(uint32_t layer) const;

 private:
  struct CachedDirectoryPage {
    std::unique_ptr<DirectoryPage> page;  // null: empty
    uint64_t memory_bytes = 0;
    uint64_t stored_bytes = 0;
  };
  using PageKey = std::pair<uint32_t, uint32_t>;      // layer, index
  using BookKey = std::pair<uint32_t, uint32_t>;      // layer, component * 16 + stage
  using BlockBookKey = std::pair<PageKey, uint32_t>;  // page, block * 4 + component
  Status load_directory_page(uint32_t layer, uint32_t index, const PageTableEntry& entry);
  Status load_codebook(const BookKey& key, const StageCoding& stage, uint32_t dim,
                       const CodebookData** out);
  Status load_entropy_tables(uint32_t layer, const EntropyTables** out);
  Status load_block_codebook(const BlockBookKey& key, const RcqTableRef& table,
                             const CodebookData& global, const CodebookData& residual,
                             const CodebookData** out);

  ByteSource source_;
  l4d_limits limits_;
  MemoryBudget memory_;
  StreamDecoder decoder_;
  FileHeader file_header_;
  SceneHeader header_;
  std::map<PageKey, CachedDirectoryPage> directory_;
  std::map<BookKey, CodebookData> codebooks_;
  std::map<uint32_t, EntropyTables> entropy_;
  std::map<BlockBookKey, CodebookData> block_books_;
  std::map<BlockBookKey, Status> failed_books_;  // codebooks, tables under page kNoPage
  uint64_t directory_memory_ = 0;
  uint64_t block_memory_ = 0;
};

}  // namespace l4d
