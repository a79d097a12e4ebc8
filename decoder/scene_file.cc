// SPDX-License-Identifier: Apache-2.0
#include "decoder/scene_file.h"

#include <algorithm>

#include "libl4dcodec/base/hash.h"

namespace l4d {
namespace {

// A seek touches a few directory pages per layer; these budgets keep playback from reading them again
// and a scan of a day-long file from holding all of them.
constexpr uint64_t kDirectoryCacheBytes = uint64_t{8} << 20;
constexpr uint64_t kBlockCacheBytes = uint64_t{64} << 20;

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
  L4D_RETURN_IF_ERROR(source_.read(file_header_.header_offset, file_header_.header_bytes, storage,
                                   &bytes));
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
  const uint64_t scratch = chunk.stored_bytes + std::min<uint64_t>(chunk.raw_bytes, max_raw_bytes);
  L4D_RETURN_IF_ERROR(memory_.charge(scratch, "a chunk"));
  ByteSpan bytes;
  Status status = source_.read(chunk.offset, chunk.stored_bytes, stored, &bytes);
  if (status.ok() && hash64(bytes) != chunk.hash) {
    status = Status(L4D_ERR_CHECKSUM, "CHNK-2", chunk.offset, "checksum of a chunk does not match");
  }
  if (status.ok()) {
    status = decode_chunk(decoder_, chunk.codec, bytes, chunk.raw_bytes, max_raw_bytes,
                          chunk.offset, storage, raw);
  }
  memory_.release(scratch);
  return status;
}

Status SceneFile::load_directory_page(uint32_t layer, uint32_t index, const PageTableEntry& entry) {
  CachedDirectoryPage cached;
  cached.stored_bytes = PageTableEntry::kBytes + entry.chunk.stored_bytes;
  if (entry.chunk.stored_bytes != 0) {
    // Raw bytes and their parsed form, which is no larger.
    cached.memory_bytes =
        2 * std::min<uint64_t>(entry.chunk.raw_bytes, kMaxDirectoryPageBytes);
    L4D_RETURN_IF_ERROR(memory_.charge(cached.memory_bytes, "a directory page"));
    directory_memory_ += cached.memory_bytes;
    Bytes stored, storage;
    ByteSpan raw;
    cached.page = std::make_unique<DirectoryPage>();
    Status status = read_chunk(entry.chunk, kMaxDirectoryPageBytes, stored, storage, &raw);
    if (status.ok()) {
      status = parse_directory_page(raw, entry.chunk.offset, header_, layer, index, cached.page.get());
    }
    if (!status.ok()) {
      memory_.release(cached.memory_bytes);
      directory_memory_ -= cached.memory_bytes;
      return status;
    }
  }
  directory_[{layer, index}] = std::move(cached);
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
    L4D_RETURN_IF_ERROR(source_.read(offset, uint64_t{end - index} * PageTableEntry::kBytes,
                                     storage, &table));
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
  const std::pair<uint32_t, uint32_t> key(owner, component * 16 + stage);
  const auto it = codebooks_.find(key);
  if (it != codebooks_.end()) {
    *out = &it->second;
    return {};
  }
  const LayerHeader& l = header_.layers[layer];
  const ComponentCoding& coding = header_.component(l, component);
  const StageCoding& s = stage == kRcqStage ? coding.rcq : coding.stages[stage];
  const uint32_t dim = header_.component_dim(l, component);
  const uint64_t bytes =
      (uint64_t{s.num_entries} * dim + CodebookData::kPadding) * sizeof(float);
  L4D_RETURN_IF_ERROR(memory_.charge(bytes, "a codebook"));
  Bytes stored, storage;
  ByteSpan raw;
  CodebookData book;
  Status status = read_chunk(s.codebook, max_codebook_bytes(s.num_entries, dim), stored, storage,
                             &raw);
  if (status.ok()) status = decode_codebook(decoder_, raw, s.codebook.offset, s, dim, &book);
  if (!status.ok()) {
    memory_.release(bytes);
    return status;
  }
  *out = &(codebooks_[key] = std::move(book));
  return {};
}

Status SceneFile::block_codebook(uint32_t layer, unsigned component, uint32_t directory_index,
                                 uint32_t block, const CodebookData** out) {
  const std::pair<PageKey, uint32_t> key({layer, directory_index}, block * 4 + component);
  const auto it = block_books_.find(key);
  if (it != block_books_.end()) {
    *out = &it->second;
    return {};
  }
  std::vector<const DirectoryPage*> pages;
  L4D_RETURN_IF_ERROR(directory_pages(layer, directory_index, directory_index, &pages));
  // A file that changes under the reader can lose the block between two reads.
  if (pages[0] == nullptr || block >= pages[0]->blocks.size() ||
      pages[0]->blocks[block].tables[component].num_entries == 0) {
    return corrupt("DIR-6", Status::kNoOffset, "block " + std::to_string(block) + " does not exist");
  }
  const RcqTableRef ref = pages[0]->blocks[block].tables[component];
  const CodebookData* global = nullptr;
  const CodebookData* residual = nullptr;
  L4D_RETURN_IF_ERROR(codebook(layer, component, 0, &global));
  L4D_RETURN_IF_ERROR(codebook(layer, component, kRcqStage, &residual));
  const uint64_t bytes =
      (uint64_t{ref.num_entries} * global->dim + CodebookData::kPadding) * sizeof(float);
  L4D_RETURN_IF_ERROR(memory_.charge(bytes, "a block codebook"));
  Bytes stored, storage;
  ByteSpan raw;
  CodebookData book;
  Status status =
      read_chunk(ref.chunk, max_rcq_table_bytes(ref.num_entries), stored, storage, &raw);
  if (status.ok()) {
    status = decode_rcq_table(decoder_, raw, ref.chunk.offset, ref.num_entries, *global, *residual,
                              &book);
  }
  if (!status.ok()) {
    memory_.release(bytes);
    return status;
  }
  block_memory_ += bytes;
  *out = &(block_books_[key] = std::move(book));
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
    for (const StageCoding& s : c.stages) bytes += s.codebook.stored_bytes;
    if (c.has_rcq) bytes += c.rcq.codebook.stored_bytes;
  }
  return bytes;
}

}  // namespace l4d
