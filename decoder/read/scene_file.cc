// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/scene_file.h"

#include <algorithm>

#include "decoder/read/losses.h"
#include "libl4dcodec/base/hash.h"

namespace l4d {
namespace {

// A seek touches a few directory pages per layer; these budgets keep playback from reading them
// again and a scan of a day-long file from holding all of them.
constexpr uint64_t kDirectoryCacheBytes = uint64_t{8} << 20;
constexpr uint64_t kBlockCacheBytes = uint64_t{64} << 20;
// What the cache itself takes for a directory page, also where that is empty: a table of 32 bytes
// an entry can name a million of them for every layer.
constexpr uint64_t kDirectoryEntryBytes = 96;

// Stands for the page of what belongs to none: layers have fewer.
constexpr uint32_t kNoPage = ~uint32_t{0};
// Beside the keys of codebooks.
constexpr uint32_t kEntropyKey = ~uint32_t{0};

}  // namespace

SceneFile::SceneFile(ByteSource source, const l4d_limits& limits, const StreamKernels& kernels)
    : source_(std::move(source)), limits_(limits) {
  decoder_.kernels = &kernels;
  memory_.set_limit(limits.max_memory_bytes);
}

Status SceneFile::open() {
  Bytes storage;
  ByteSpan bytes;
  const uint64_t head = std::min<uint64_t>(source_.size(), FileHeader::kBytes);
  L4D_RETURN_IF_ERROR(source_.read(0, head, storage, &bytes));
  L4D_RETURN_IF_ERROR(FileHeader::parse(bytes, &file_header_));
  L4D_RETURN_IF_ERROR(memory_.charge(file_header_.header_bytes, "the scene header"));
  L4D_RETURN_IF_ERROR(
      source_.read(file_header_.header_offset, file_header_.header_bytes, storage, &bytes));
  if (hash64(bytes) != file_header_.header_hash) {
    return Status(L4D_ERR_CHECKSUM, "FILE-6", file_header_.header_offset,
                  "checksum of the scene header does not match");
  }
  L4D_RETURN_IF_ERROR(parse_scene_header(bytes, file_header_.header_offset, &header_));
  if (header_.num_gaussians > limits_.max_gaussians) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, std::to_string(header_.num_gaussians) +
                                              " Gaussians; the limit is " +
                                              std::to_string(limits_.max_gaussians));
  }
  if (header_.timeline.num_frames > limits_.max_frames) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, std::to_string(header_.timeline.num_frames) +
                                              " frames; the limit is " +
                                              std::to_string(limits_.max_frames));
  }
  return {};
}

Status SceneFile::read_chunk(const ChunkRef& chunk, uint64_t max_raw_bytes, Bytes& stored,
                             Bytes& storage, ByteSpan* raw) {
  // The buffers are short-lived, but their sizes come from the file.
  MemoryCharge scratch(memory_);
  L4D_RETURN_IF_ERROR(scratch.take(
      chunk.stored_bytes + std::min<uint64_t>(chunk.raw_bytes, max_raw_bytes), "a chunk"));
  ByteSpan bytes;
  L4D_RETURN_IF_ERROR(source_.read(chunk.offset, chunk.stored_bytes, stored, &bytes));
  if (hash64(bytes) != chunk.hash) {
    return Status(L4D_ERR_CHECKSUM, "CHNK-2", chunk.offset, "checksum of a chunk does not match");
  }
  return decode_chunk(decoder_, chunk.codec, bytes, chunk.raw_bytes, max_raw_bytes, chunk.offset,
                      storage, raw);
}

Status SceneFile::load_directory_page(uint32_t layer, uint32_t index, const PageTableEntry& entry) {
  CachedDirectoryPage cached;
  cached.stored_bytes = PageTableEntry::kBytes + entry.chunk.stored_bytes;
  cached.memory_bytes = kDirectoryEntryBytes;
  // Raw bytes and their parsed form, which is about as large.
  if (entry.chunk.stored_bytes != 0) {
    cached.memory_bytes += 2 * std::min<uint64_t>(entry.chunk.raw_bytes, kMaxDirectoryPageBytes);
  }
  MemoryCharge charge(memory_);
  L4D_RETURN_IF_ERROR(charge.take(cached.memory_bytes, "a directory page"));
  if (entry.chunk.stored_bytes != 0) {
    Bytes stored, storage;
    ByteSpan raw;
    cached.page = std::make_unique<DirectoryPage>();
    L4D_RETURN_IF_ERROR(read_chunk(entry.chunk, kMaxDirectoryPageBytes, stored, storage, &raw));
    L4D_RETURN_IF_ERROR(
        parse_directory_page(raw, entry.chunk.offset, header_, layer, index, cached.page.get()));
  }
  const uint64_t memory_bytes = cached.memory_bytes;
  directory_[{layer, index}] = std::move(cached);
  charge.keep();
  directory_memory_ += memory_bytes;
  return {};
}

Status SceneFile::directory_pages(uint32_t layer, uint32_t first, uint32_t last,
                                  std::vector<const DirectoryPage*>* out) {
  out->clear();
  const LayerHeader& l = header_.layers[layer];
  for (uint32_t index = first; index <= last; ++index) {
    if (directory_.count({layer, index}) != 0) continue;
    // One read of the table for the run of pages not yet known.
    uint32_t end = index + 1;
    while (end <= last && directory_.count({layer, end}) == 0) ++end;
    Bytes storage;
    ByteSpan table;
    const uint64_t offset = l.page_table_offset + uint64_t{index} * PageTableEntry::kBytes;
    L4D_RETURN_IF_ERROR(
        source_.read(offset, uint64_t{end - index} * PageTableEntry::kBytes, storage, &table));
    for (uint32_t i = index; i < end; ++i) {
      const size_t at = size_t{i - index} * PageTableEntry::kBytes;
      PageTableEntry entry;
      L4D_RETURN_IF_ERROR(
          PageTableEntry::parse(table.subspan(at, PageTableEntry::kBytes), offset + at, &entry));
      L4D_RETURN_IF_ERROR(load_directory_page(layer, i, entry));
    }
  }
  for (uint32_t index = first; index <= last; ++index) {
    out->push_back(directory_[{layer, index}].page.get());
  }
  return {};
}

uint64_t SceneFile::directory_bytes(uint32_t layer, uint32_t index) const {
  const auto it = directory_.find({layer, index});
  return it == directory_.end() ? 0 : it->second.stored_bytes;
}

Status SceneFile::codebook(uint32_t layer, unsigned component, unsigned stage,
                           const CodebookData** out) {
  // SH is global: one key for all layers.
  const uint32_t owner = component == L4D_COMPONENT_SH ? 0 : layer;
  const BookKey key(owner, component * 16 + stage);
  const auto it = codebooks_.find(key);
  if (it != codebooks_.end()) {
    *out = &it->second;
    return {};
  }
  const BlockBookKey failed_key({owner, kNoPage}, key.second);
  const auto failed = failed_books_.find(failed_key);
  if (failed != failed_books_.end()) return failed->second;
  const LayerHeader& l = header_.layers[layer];
  const ComponentCoding& coding = header_.component(l, component);
  const Status status = load_codebook(key, stage == kRcqStage ? coding.rcq : coding.book(stage),
                                      header_.component_dim(l, component), out);
  if (is_loss(status)) failed_books_[failed_key] = status;
  return status;
}

Status SceneFile::load_codebook(const BookKey& key, const StageCoding& stage, uint32_t dim,
                                const CodebookData** out) {
  MemoryCharge charge(memory_);
  L4D_RETURN_IF_ERROR(charge.take(
      (uint64_t{stage.num_entries} * dim + CodebookData::kPadding) * sizeof(float), "a codebook"));
  Bytes stored, storage;
  ByteSpan raw;
  CodebookData book;
  L4D_RETURN_IF_ERROR(read_chunk(stage.codebook, max_codebook_bytes(stage.num_entries, dim), stored,
                                 storage, &raw));
  L4D_RETURN_IF_ERROR(decode_codebook(decoder_, raw, stage.codebook.offset, stage, dim, &book));
  *out = &(codebooks_[key] = std::move(book));
  charge.keep();
  return {};
}

Status SceneFile::entropy_tables(uint32_t layer, const EntropyTables** out) {
  const auto it = entropy_.find(layer);
  if (it != entropy_.end()) {
    *out = &it->second;
    return {};
  }
  const BlockBookKey failed_key({layer, kNoPage}, kEntropyKey);
  const auto failed = failed_books_.find(failed_key);
  if (failed != failed_books_.end()) return failed->second;
  const Status status = load_entropy_tables(layer, out);
  if (is_loss(status)) failed_books_[failed_key] = status;
  return status;
}

Status SceneFile::load_entropy_tables(uint32_t layer, const EntropyTables** out) {
  const LayerHeader& l = header_.layers[layer];
  if (!l.has_entropy || !rans_codable(header_, l)) {
    return corrupt("RANS-6", Status::kNoOffset,
                   "a rANS page in layer " + std::to_string(layer) + ", which cannot have one");
  }
  const std::vector<PlaneSpec> planes = page_planes(header_, l);
  Bytes stored, storage;
  ByteSpan raw;
  L4D_RETURN_IF_ERROR(read_chunk(l.entropy, max_entropy_bytes(planes), stored, storage, &raw));
  MemoryCharge charge(memory_);
  L4D_RETURN_IF_ERROR(charge.take(entropy_memory(raw, planes), "entropy tables"));
  EntropyTables tables;
  L4D_RETURN_IF_ERROR(parse_entropy_tables(raw, l.entropy.offset, header_, l, &tables));
  *out = &(entropy_[layer] = std::move(tables));
  charge.keep();
  return {};
}

Status SceneFile::block_codebook(uint32_t layer, unsigned component, uint32_t directory_index,
                                 uint32_t block, const CodebookData** out) {
  const BlockBookKey key({layer, directory_index}, block * 4 + component);
  const auto it = block_books_.find(key);
  if (it != block_books_.end()) {
    *out = &it->second;
    return {};
  }
  const auto failed = failed_books_.find(key);
  if (failed != failed_books_.end()) return failed->second;
  std::vector<const DirectoryPage*> pages;
  L4D_RETURN_IF_ERROR(directory_pages(layer, directory_index, directory_index, &pages));
  // A file that changes under the reader can lose the block between two reads.
  if (pages[0] == nullptr || block >= pages[0]->blocks.size() ||
      pages[0]->blocks[block].tables[component].num_entries == 0) {
    return corrupt("DIR-6", Status::kNoOffset,
                   "block " + std::to_string(block) + " does not exist");
  }
  const RcqTableRef table = pages[0]->blocks[block].tables[component];
  const CodebookData* global = nullptr;
  const CodebookData* residual = nullptr;
  L4D_RETURN_IF_ERROR(codebook(layer, component, 0, &global));
  L4D_RETURN_IF_ERROR(codebook(layer, component, kRcqStage, &residual));
  const Status status = load_block_codebook(key, table, *global, *residual, out);
  if (is_loss(status)) failed_books_[key] = status;
  return status;
}

Status SceneFile::load_block_codebook(const BlockBookKey& key, const RcqTableRef& table,
                                      const CodebookData& global, const CodebookData& residual,
                                      const CodebookData** out) {
  MemoryCharge charge(memory_);
  const uint64_t bytes =
      (uint64_t{table.num_entries} * global.dim + CodebookData::kPadding) * sizeof(float);
  L4D_RETURN_IF_ERROR(charge.take(bytes, "a block codebook"));
  Bytes stored, storage;
  ByteSpan raw;
  CodebookData book;
  L4D_RETURN_IF_ERROR(
      read_chunk(table.chunk, max_rcq_table_bytes(table.num_entries), stored, storage, &raw));
  L4D_RETURN_IF_ERROR(decode_rcq_table(decoder_, raw, table.chunk.offset, table.num_entries, global,
                                       residual, &book));
  *out = &(block_books_[key] = std::move(book));
  charge.keep();
  block_memory_ += bytes;
  return {};
}

void SceneFile::trim() {
  if (directory_memory_ > kDirectoryCacheBytes) {
    directory_.clear();
    memory_.release(directory_memory_);
    directory_memory_ = 0;
  }
  if (block_memory_ > kBlockCacheBytes) {
    block_books_.clear();
    memory_.release(block_memory_);
    block_memory_ = 0;
  }
}

uint64_t SceneFile::codebook_stored_bytes(uint32_t layer) const {
  uint64_t bytes = 0;
  for (const ComponentCoding& c : header_.layers[layer].component) {
    for (size_t s = 0; s < c.num_books(); ++s) bytes += c.book(s).codebook.stored_bytes;
    if (c.has_rcq) bytes += c.rcq.codebook.stored_bytes;
  }
  return bytes;
}

}  // namespace l4d
