// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/directory_cache.h"

#include <algorithm>

#include "decoder/read/losses.h"

namespace l4d {
namespace {

// A seek touches a few directory pages per layer; this budget keeps playback from reading them
// again and a scan of a day-long file from holding all of them.
constexpr uint64_t kCacheBytes = uint64_t{8} << 20;
// What the cache itself takes for a directory page, also where that is empty: a table of 32 bytes
// an entry can name a million of them for every layer.
constexpr uint64_t kEntryBytes = 96;
constexpr uint64_t kExtentBytes = 96;  // a node of the map

}  // namespace

DirectoryScan::~DirectoryScan() {
  directory_.reader_.memory().release(directory_.extents_.size() * kExtentBytes);
  directory_.extents_.clear();
  directory_.in_scan_ = false;
}

void DirectoryCache::trim() {
  if (cache_memory_ > kCacheBytes) drop();
}

void DirectoryCache::drop() {
  reader_.memory().release(cache_.size() * kEntryBytes);
  cache_.clear();
  cache_memory_ = 0;
}

Status DirectoryCache::take_extent(const PageKey& key, const ChunkRef& chunk) {
  const uint64_t size = reader_.source().size();
  // What the file does not hold is refused when it is read.
  if (chunk.offset > size || chunk.stored_bytes > size - chunk.offset) return {};
  const uint64_t end = chunk.offset + chunk.stored_bytes;
  const auto next = extents_.lower_bound(chunk.offset);
  const auto shares = [&](const auto& it) {
    return it->second.end > chunk.offset && it->first < end && it->second.page != key;
  };
  if ((next != extents_.end() && shares(next)) ||
      (next != extents_.begin() && shares(std::prev(next)))) {
    return corrupt("CHNK-4", chunk.offset, "two directory pages share stored bytes");
  }
  if (next != extents_.end() && next->first == chunk.offset) return {};  // read again
  MemoryCharge charge(reader_.memory());
  L4D_RETURN_IF_ERROR(charge.take(kExtentBytes, "a directory page"));
  extents_.emplace_hint(next, chunk.offset, Extent{end, key});
  charge.keep();
  return {};
}

Status DirectoryCache::load(uint32_t layer, uint32_t index, ByteSpan bytes) {
  const PageKey key(layer, index);
  const uint64_t at =
      header_.layers[layer].page_table_offset + uint64_t{index} * PageTableEntry::kBytes;
  PageTableEntry entry;
  L4D_RETURN_IF_ERROR(reader_.source().after_check(PageTableEntry::parse(bytes, at, &entry)));
  const ChunkRef& chunk = entry.chunk;
  MemoryCharge place(reader_.memory());
  L4D_RETURN_IF_ERROR(place.take(kEntryBytes, "a directory page"));
  uint64_t memory_bytes = kEntryBytes;
  DirectoryPageRef loaded;
  if (chunk.stored_bytes == 0) {
    if (empty_ == nullptr) {
      auto empty = std::make_shared<LoadedDirectoryPage>(reader_.memory());
      empty->stored_bytes = PageTableEntry::kBytes;
      empty_ = std::move(empty);
    }
    loaded = empty_;
  } else {
    if (in_scan_) L4D_RETURN_IF_ERROR(take_extent(key, chunk));
    auto page = std::make_shared<LoadedDirectoryPage>(reader_.memory());
    // Raw bytes and their parsed form, which is about as large.
    const uint64_t page_bytes = 2 * std::min<uint64_t>(chunk.raw_bytes, kMaxDirectoryPageBytes);
    L4D_RETURN_IF_ERROR(page->memory.take(page_bytes, "a directory page"));
    Bytes stored, storage;
    ByteSpan raw;
    L4D_RETURN_IF_ERROR(reader_.read(chunk, kMaxDirectoryPageBytes, stored, storage, &raw));
    L4D_RETURN_IF_ERROR(
        parse_directory_page(raw, chunk.offset, header_, layer, index, &page->page));
    page->stored_bytes = PageTableEntry::kBytes + chunk.stored_bytes;
    memory_bytes += page_bytes;
    loaded = std::move(page);
  }
  cache_[key] = std::move(loaded);
  place.keep();
  cache_memory_ += memory_bytes;
  return {};
}

Status DirectoryCache::read_entries(uint32_t layer, uint32_t first, uint32_t end, Bytes& storage,
                                    ByteSpan* out) {
  const uint64_t offset =
      header_.layers[layer].page_table_offset + uint64_t{first} * PageTableEntry::kBytes;
  return reader_.source().read(offset, uint64_t{end - first} * PageTableEntry::kBytes, storage,
                               out);
}

Status DirectoryCache::load_run(uint32_t layer, uint32_t first, uint32_t end,
                                std::vector<Failure>* failures) {
  const auto may_lose = [&](const Status& s) { return failures != nullptr && is_loss(s); };
  Bytes storage;
  ByteSpan table;
  const Status together = read_entries(layer, first, end, storage, &table);
  if (!together.ok() && !may_lose(together)) return together;
  for (uint32_t i = first; i < end; ++i) {
    ByteSpan entry;
    Status status;
    if (together.ok()) {
      entry = table.subspan(size_t{i - first} * PageTableEntry::kBytes, PageTableEntry::kBytes);
    } else {
      status = read_entries(layer, i, i + 1, storage, &entry);
    }
    if (status.ok()) status = load(layer, i, entry);
    if (status.ok()) continue;
    if (!may_lose(status)) return status;
    failures->push_back({i, std::move(status)});
  }
  return {};
}

Status DirectoryCache::pages(uint32_t layer, uint32_t first, uint32_t last,
                             std::vector<DirectoryPageRef>* out, std::vector<Failure>* failures) {
  out->clear();
  if (failures != nullptr) failures->clear();
  for (uint32_t index = first; index <= last;) {
    if (cache_.count({layer, index}) != 0) {
      ++index;
      continue;
    }
    // One read of the table for the run of pages not yet known.
    uint32_t end = index + 1;
    while (end <= last && cache_.count({layer, end}) == 0) ++end;
    L4D_RETURN_IF_ERROR(load_run(layer, index, end, failures));
    index = end;
  }
  for (uint32_t index = first; index <= last; ++index) {
    const auto it = cache_.find({layer, index});
    out->push_back(it == cache_.end() ? nullptr : it->second);
  }
  return {};
}

bool DirectoryCache::holds(uint32_t layer, uint32_t first, uint32_t last) const {
  for (uint32_t index = first; index <= last; ++index) {
    if (cache_.count({layer, index}) == 0) return false;
  }
  return true;
}

Status DirectoryCache::page(uint32_t layer, uint32_t index, DirectoryPageRef* out) {
  std::vector<DirectoryPageRef> one;
  L4D_RETURN_IF_ERROR(pages(layer, index, index, &one));
  *out = std::move(one[0]);
  return {};
}

}  // namespace l4d
