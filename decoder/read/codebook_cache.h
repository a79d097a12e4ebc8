// SPDX-License-Identifier: Apache-2.0
// What pages are decoded with besides their own bytes: codebooks, those of blocks, entropy tables.
#pragma once

#include <map>
#include <tuple>
#include <utility>

#include "decoder/read/chunk_reader.h"
#include "libl4dcodec/container/channels.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/quant/codebook.h"

namespace l4d {

// A block of a layer. `index` counts within the directory page.
struct BlockId {
  uint32_t layer = 0;
  uint32_t directory_index = 0;
  uint32_t index = 0;
};

// Reads each on first use. One that cannot be read fails at once when it is asked for again, since
// every page of its layer does, until retry() is called.
class CodebookCache {
 public:
  CodebookCache(ChunkReader& reader, const SceneHeader& header)
      : reader_(reader), header_(header) {}

  // The codebook of a stage, of the residual codebook (stage = kRcqStage), or of a block, whose
  // table the directory names. Pointers to block codebooks live until the next trim(), the others
  // as long as this object.
  static constexpr unsigned kRcqStage = L4D_MAX_STAGES;
  Status codebook(uint32_t layer, unsigned component, unsigned stage, const CodebookData** out);
  Status block_codebook(const BlockId& block, unsigned component, const RcqTableRef& table,
                        const CodebookData** out);

  // Tables of the layer's rans32 pages; they live as long as this object.
  Status entropy_tables(uint32_t layer, const EntropyTables** out);

  void retry() { failed_.clear(); }
  // Drops block codebooks where they take more than a budget: what a long playback has passed.
  void trim();

 private:
  using CodebookKey = std::pair<uint32_t, uint32_t>;                    // layer, what of it
  using BlockKey = std::tuple<uint32_t, uint32_t, uint32_t, unsigned>;  // a BlockId, component
  Status load_codebook(const CodebookKey& key, const StageCoding& stage, uint32_t dim,
                       const CodebookData** out);
  Status load_entropy_tables(uint32_t layer, const EntropyTables** out);
  Status load_block_codebook(const BlockKey& key, const RcqTableRef& table,
                             const CodebookData& global, const CodebookData& residual,
                             const CodebookData** out);

  ChunkReader& reader_;
  const SceneHeader& header_;
  std::map<CodebookKey, CodebookData> codebooks_;
  std::map<uint32_t, EntropyTables> entropy_;
  std::map<BlockKey, CodebookData> block_codebooks_;
  std::map<BlockKey, Status> failed_;  // what belongs to no block under block kNoBlock
  uint64_t block_memory_ = 0;
};

}  // namespace l4d
