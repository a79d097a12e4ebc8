// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/codebook_cache.h"

#include <string>
#include <vector>

#include "decoder/read/losses.h"

namespace l4d {
namespace {

constexpr uint64_t kBlockCacheBytes = uint64_t{64} << 20;
// Beside the keys of codebooks, which are component * 16 + stage.
constexpr uint32_t kEntropyKey = ~uint32_t{0};

}  // namespace

Status CodebookCache::codebook(uint32_t layer, unsigned component, unsigned stage,
                               const CodebookData** out) {
  // SH is global: one key for all layers.
  const uint32_t owner = component == L4D_COMPONENT_SH ? 0 : layer;
  const CodebookKey key(owner, component * 16 + stage);
  const auto it = codebooks_.find(key);
  if (it != codebooks_.end()) {
    *out = &it->second;
    return {};
  }
  const BlockKey failed_key(owner, 0, kNoBlock, key.second);
  const auto failed = failed_.find(failed_key);
  if (failed != failed_.end()) return failed->second;
  const LayerHeader& l = header_.layers[layer];
  const ComponentCoding& coding = header_.component(l, component);
  const Status status = load_codebook(key, stage == kRcqStage ? coding.rcq : coding.codebook(stage),
                                      header_.component_dim(l, component), out);
  if (is_loss(status)) failed_[failed_key] = status;
  return status;
}

Status CodebookCache::load_codebook(const CodebookKey& key, const StageCoding& stage, uint32_t dim,
                                    const CodebookData** out) {
  // One key for all layers: SH is global.
  const bool integer = header_.sh.transform() && &stage == &header_.sh.basis;
  MemoryCharge charge(reader_.memory());
  L4D_RETURN_IF_ERROR(
      charge.take((uint64_t{stage.num_entries} * dim + CodebookData::kPadding) * sizeof(float) +
                      (integer ? uint64_t{stage.num_entries} * dim * sizeof(int16_t) : 0),
                  "a codebook"));
  Bytes stored, storage;
  ByteSpan raw;
  CodebookData codebook;
  L4D_RETURN_IF_ERROR(reader_.read(stage.codebook, max_codebook_bytes(stage.num_entries, dim),
                                   stored, storage, &raw));
  L4D_RETURN_IF_ERROR(
      decode_codebook(reader_.decoder(), raw, stage.codebook.offset, stage, dim, &codebook));
  if (integer) {
    codebook.integer = integer_basis(codebook.entries.data(), dim, header_.sh.steps.data(),
                                     header_.sh.steps.size());
  }
  *out = &(codebooks_[key] = std::move(codebook));
  charge.keep();
  return {};
}

Status CodebookCache::entropy_tables(uint32_t layer, const EntropyTables** out) {
  const auto it = entropy_.find(layer);
  if (it != entropy_.end()) {
    *out = &it->second;
    return {};
  }
  const BlockKey failed_key(layer, 0, kNoBlock, kEntropyKey);
  const auto failed = failed_.find(failed_key);
  if (failed != failed_.end()) return failed->second;
  const Status status = load_entropy_tables(layer, out);
  if (is_loss(status)) failed_[failed_key] = status;
  return status;
}

Status CodebookCache::load_entropy_tables(uint32_t layer, const EntropyTables** out) {
  const LayerHeader& l = header_.layers[layer];
  if (!l.has_entropy || !rans_codable(header_, l)) {
    return corrupt("RANS-6", Status::kNoOffset,
                   "a rANS page in layer " + std::to_string(layer) + ", which cannot have one");
  }
  const std::vector<ChannelSpec> channels = page_channels(header_, l);
  Bytes stored, storage;
  ByteSpan raw;
  L4D_RETURN_IF_ERROR(reader_.read(l.entropy, max_entropy_bytes(channels), stored, storage, &raw));
  MemoryCharge charge(reader_.memory());
  L4D_RETURN_IF_ERROR(charge.take(entropy_memory(raw, channels), "entropy tables"));
  EntropyTables tables;
  L4D_RETURN_IF_ERROR(parse_entropy_tables(raw, l.entropy.offset, header_, l, &tables));
  *out = &(entropy_[layer] = std::move(tables));
  charge.keep();
  return {};
}

Status CodebookCache::block_codebook(const BlockId& block, unsigned component,
                                     const RcqTableRef& table, const CodebookData** out) {
  const BlockKey key(block.layer, block.directory_index, block.index, component);
  const auto it = block_codebooks_.find(key);
  if (it != block_codebooks_.end()) {
    *out = &it->second;
    return {};
  }
  const auto failed = failed_.find(key);
  if (failed != failed_.end()) return failed->second;
  const CodebookData* global = nullptr;
  const CodebookData* residual = nullptr;
  L4D_RETURN_IF_ERROR(codebook(block.layer, component, 0, &global));
  L4D_RETURN_IF_ERROR(codebook(block.layer, component, kRcqStage, &residual));
  const Status status = load_block_codebook(key, table, *global, *residual, out);
  if (is_loss(status)) failed_[key] = status;
  return status;
}

Status CodebookCache::load_block_codebook(const BlockKey& key, const RcqTableRef& table,
                                          const CodebookData& global, const CodebookData& residual,
                                          const CodebookData** out) {
  MemoryCharge charge(reader_.memory());
  const uint64_t bytes =
      (uint64_t{table.num_entries} * global.dim + CodebookData::kPadding) * sizeof(float);
  L4D_RETURN_IF_ERROR(charge.take(bytes, "a block codebook"));
  Bytes stored, storage;
  ByteSpan raw;
  CodebookData codebook;
  L4D_RETURN_IF_ERROR(
      reader_.read(table.chunk, max_rcq_table_bytes(table.num_entries), stored, storage, &raw));
  L4D_RETURN_IF_ERROR(decode_rcq_table(reader_.decoder(), raw, table.chunk.offset,
                                       table.num_entries, global, residual, &codebook));
  *out = &(block_codebooks_[key] = std::move(codebook));
  charge.keep();
  block_memory_ += bytes;
  return {};
}

void CodebookCache::trim() {
  if (block_memory_ <= kBlockCacheBytes) return;
  block_codebooks_.clear();
  reader_.memory().release(block_memory_);
  block_memory_ = 0;
}

}  // namespace l4d
