// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/stream_map.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "decoder/read/losses.h"
#include "decoder/read/query_buckets.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d::playback {
namespace {

// A directory with so many pages is fetched whole when nothing else is to be done.
constexpr uint64_t kMostIdlePages = 2048;
// What a header of a few bytes can ask for must not fill memory.
constexpr size_t kMostChunks = size_t{1} << 21;

uint64_t key_of(uint32_t layer, uint32_t number) { return uint64_t{layer} << 32 | number; }

template <typename T>
auto lower_bound_of(T& chunks, uint64_t offset) {
  return std::lower_bound(chunks.begin(), chunks.end(), offset,
                          [](const Chunk& c, uint64_t value) { return c.offset < value; });
}

}  // namespace

void StreamMap::open(uint64_t file_size) {
  file_size_ = file_size;
  is_open_ = false;
  header_status_ = L4D_OK;
  ladder_ = Ladder();
  chunks_.clear();
  items_.clear();
  refs_.clear();
  file_header_ = FileHeader();
  is_stale_ = true;
}

void StreamMap::set_file_size(uint64_t bytes) {
  file_size_ = bytes;
  is_stale_ = true;
}

size_t StreamMap::first_chunk_at(uint64_t offset) const {
  const uint64_t from = offset - std::min(offset, longest_);
  return static_cast<size_t>(lower_bound_of(chunks_, from) - chunks_.begin());
}

bool StreamMap::is_known_right(uint64_t offset) const {
  const auto it = lower_bound_of(old_, offset);
  return it != old_.end() && it->offset == offset && it->right;
}

void StreamMap::lose(const Chunk& chunk, uint32_t cause, double now,
                     std::vector<ChunkEvent>* events) {
  if (!ledger_.lose(chunk.offset, chunk.size, cause, now)) return;
  events->push_back({L4D_EVENT_LOST, cause, stream_, chunk.offset, chunk.size});
}

bool StreamMap::is_right(const Chunk& chunk, uint64_t* hash) {
  scratch_.resize(chunk.size);
  blocks_.read(chunk.offset, chunk.size, scratch_.data());
  const ByteSpan bytes(scratch_.data(), scratch_.size());
  *hash = hash64(bytes);
  if (chunk.kind == ChunkKind::kFileHeader) {
    header_status_ = FileHeader::parse(bytes, &file_header_).code();
    return header_status_ == L4D_OK;
  }
  if (chunk.kind == ChunkKind::kPageEntry) {
    PageTableEntry entry;
    return PageTableEntry::parse(bytes, chunk.offset, &entry).code() != L4D_ERR_CHECKSUM;
  }
  return *hash == chunk.hash;
}

void StreamMap::check_one(Chunk* chunk, double now, std::vector<ChunkEvent>* events) {
  if (chunk->right) return;
  chunk->gap = blocks_.gap_begin(chunk->gap, chunk->end());
  if (chunk->gap < chunk->end()) return;
  // While nobody wanted the chunk, some of it may have been evicted.
  chunk->gap = blocks_.gap_begin(chunk->offset, chunk->end());
  if (chunk->gap < chunk->end()) return;
  const Ledger::Entry* const entry = ledger_.find(chunk->offset);
  // Bytes that are known to be wrong are looked at again when others have taken their place.
  if (entry != nullptr && entry->size == chunk->size && entry->wrong > 0 &&
      entry->next < chunk->end()) {
    return;
  }
  uint64_t hash = 0;
  if (is_right(*chunk, &hash)) {
    chunk->right = true;
    if (ledger_.set_right(chunk->offset)) {
      events->push_back({L4D_EVENT_FOUND, L4D_CAUSE_NONE, stream_, chunk->offset, chunk->size});
    }
    // The directory names pages, headers name the directory.
    is_stale_ = is_stale_ || chunk->kind != ChunkKind::kPage;
    return;
  }
  const bool was_lost = entry != nullptr && entry->losses > 0;
  if (ledger_.add_wrong(chunk->offset, chunk->size, hash, now) && !was_lost) {
    events->push_back(
        {L4D_EVENT_LOST, ledger_.find(chunk->offset)->cause, stream_, chunk->offset, chunk->size});
  }
}

void StreamMap::check(uint64_t begin, uint64_t end, double now, std::vector<ChunkEvent>* events) {
  for (size_t i = first_chunk_at(begin); i < chunks_.size() && chunks_[i].offset < end; ++i) {
    if (chunks_[i].end() > begin) check_one(&chunks_[i], now, events);
  }
  is_unchecked_ = false;
}

const Ledger::Entry* StreamMap::lost_header() const {
  for (const Chunk& chunk : chunks_) {
    if (chunk.kind != ChunkKind::kFileHeader && chunk.kind != ChunkKind::kSceneHeader) continue;
    const Ledger::Entry* const entry = ledger_.find(chunk.offset);
    if (!chunk.right && entry != nullptr && entry->lost) return entry;
  }
  return nullptr;
}

Status StreamMap::try_open(double now) {
  if (is_open_ ||
      !std::all_of(chunks_.begin(), chunks_.end(), [](const Chunk& c) { return c.right; })) {
    return {};
  }
  const auto it = std::find_if(chunks_.begin(), chunks_.end(),
                               [](const Chunk& c) { return c.kind == ChunkKind::kSceneHeader; });
  if (it == chunks_.end()) return {};
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = this;
  reader.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    const StreamMap& map = *static_cast<StreamMap*>(user);
    if (map.blocks_.gap_begin(offset, offset + n) < offset + n) return -1;
    map.blocks_.read(offset, n, static_cast<unsigned char*>(dst));
    return static_cast<int64_t>(n);
  };
  reader.size = [](void* user) -> int64_t {
    return static_cast<int64_t>(
        std::min<uint64_t>(static_cast<StreamMap*>(user)->file_size_, INT64_MAX));
  };
  ByteSource source;
  L4D_RETURN_IF_ERROR(ByteSource::from_reader(reader, &source));
  source.set_gaps();
  const Status opened = decoder_.open(std::move(source));
  if (!opened.ok()) {
    ledger_.lose(it->offset, it->size, L4D_CAUSE_CORRUPT, now);
    it->right = false;
    header_status_ = opened.code();
    return opened;
  }
  ladder_ = Ladder(decoder_.file().header());
  is_open_ = is_stale_ = true;
  return {};
}

void StreamMap::begin_item(uint32_t layer, uint32_t bucket, uint32_t rung, double begin,
                           double end) {
  Item item;
  item.layer = layer;
  item.bucket = bucket;
  item.rung = rung;
  item.begin = begin;
  item.end = end;
  item.first = refs_.size();
  items_.push_back(item);
}

void StreamMap::add(const ChunkRef& ref, ChunkKind kind, uint32_t rung, uint32_t layer,
                    uint32_t index) {
  if (ref.stored_bytes == 0) return;
  Chunk chunk;
  chunk.offset = chunk.gap = ref.offset;
  chunk.hash = ref.hash;
  chunk.size = ref.stored_bytes;
  chunk.kind = kind;
  chunk.rung = rung;
  chunk.layer = layer;
  chunk.index = index;
  refs_.push_back(static_cast<uint32_t>(chunks_.size()));
  chunks_.push_back(chunk);
  ++items_.back().num_base;
}

void StreamMap::add_headers() {
  begin_item(0, Item::kNoBucket, 0, -HUGE_VAL, HUGE_VAL);
  ChunkRef head;
  head.stored_bytes = static_cast<uint32_t>(std::min<uint64_t>(FileHeader::kBytes, file_size_));
  add(head, ChunkKind::kFileHeader, 0);
  if (!is_known_right(0)) return;
  ChunkRef scene;
  scene.offset = file_header_.header_offset;
  scene.stored_bytes = file_header_.header_bytes;
  scene.hash = file_header_.header_hash;
  add(scene, ChunkKind::kSceneHeader, 0);
}

void StreamMap::add_tables() {
  const SceneHeader& header = decoder_.file().header();
  const auto add_codebooks = [&](const ComponentCoding& c, uint32_t rung) {
    for (unsigned s = 0; s < c.num_codebooks(); ++s) {
      add(c.codebook(s).codebook, ChunkKind::kTable, rung);
    }
    if (c.has_rcq) add(c.rcq.codebook, ChunkKind::kTable, rung);
  };
  begin_item(0, Item::kNoBucket, 0, -HUGE_VAL, HUGE_VAL);
  add_codebooks(header.sh, 0);
  for (uint32_t l = 0; l < header.layers.size(); ++l) {
    const LayerHeader& layer = header.layers[l];
    if (layer.num_gaussians == 0) continue;
    const uint32_t rung = ladder_.rung_of_tier(layer.tier);
    begin_item(l, Item::kNoBucket, rung, -HUGE_VAL, HUGE_VAL);
    if (layer.has_entropy) add(layer.entropy, ChunkKind::kTable, rung);
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      add_codebooks(layer.component[c], rung);
    }
  }
}

void StreamMap::add_directory(uint32_t l, uint32_t index, double now,
                              std::vector<ChunkEvent>* events) {
  const uint64_t key = key_of(l, index);
  const auto place = std::lower_bound(listed_pages_.begin(), listed_pages_.end(), key);
  if (place != listed_pages_.end() && *place == key) return;
  listed_pages_.insert(place, key);
  const SceneHeader& header = decoder_.file().header();
  const LayerHeader& layer = header.layers[l];
  const uint32_t first = index << layer.directory_bits;
  const uint32_t last =
      std::min(num_buckets(layer.level) - 1, first + (uint32_t{1} << layer.directory_bits) - 1);
  // Of a bucket, something may be visible two widths from its centre.
  const double reach = 2 * bucket_width(header.timeline, layer.level);
  const double begin = bucket_center(header.timeline, layer.level, first) - reach;
  const double until = bucket_center(header.timeline, layer.level, last) + reach;
  begin_item(l, Item::kNoBucket, ladder_.rung_of_tier(layer.tier),
             layer.permanent ? -HUGE_VAL : begin, layer.permanent ? HUGE_VAL : until);
  ChunkRef ref;
  ref.offset = layer.page_table_offset + uint64_t{index} * PageTableEntry::kBytes;
  ref.stored_bytes = PageTableEntry::kBytes;
  add(ref, ChunkKind::kPageEntry, items_.back().rung);
  const uint64_t end = ref.offset + ref.stored_bytes;
  if (!is_known_right(ref.offset) || blocks_.gap_begin(ref.offset, end) < end) return;
  unsigned char bytes[PageTableEntry::kBytes];
  blocks_.read(ref.offset, sizeof bytes, bytes);
  PageTableEntry entry;
  const Status parsed = PageTableEntry::parse(ByteSpan(bytes, sizeof bytes), ref.offset, &entry);
  if (!parsed.ok()) {
    lose(chunks_.back(), L4D_CAUSE_CORRUPT, now, events);
    return;
  }
  if (entry.chunk.stored_bytes == 0) return;
  add(entry.chunk, ChunkKind::kDirectory, items_.back().rung, l, index);
}

void StreamMap::add_whole_directory(double now, std::vector<ChunkEvent>* events) {
  const SceneHeader& header = decoder_.file().header();
  uint64_t pages = 0;
  for (const LayerHeader& layer : header.layers) {
    if (layer.num_gaussians > 0) pages += num_directory_pages(layer);
  }
  if (pages > kMostIdlePages) return;
  for (uint32_t l = 0; l < header.layers.size(); ++l) {
    if (header.layers[l].num_gaussians == 0) continue;
    const uint32_t count = num_directory_pages(header.layers[l]);
    for (uint32_t index = 0; index < count; ++index) add_directory(l, index, now, events);
  }
}

Status StreamMap::add_pages(const l4d_query& query) {
  SceneFile& file = decoder_.file();
  file.trim();
  Plan plan;
  Losses missing;
  L4D_RETURN_IF_ERROR(make_plan(file, query, &missing, &plan));
  std::vector<uint64_t> listed = listed_buckets_;
  const bool splits = ladder_.has_detail;
  const uint32_t top = ladder_.size() - 1;
  for (size_t t = 0, end; t < plan.tasks.size(); t = end) {
    const l4d_bucket_span& span = plan.spans[plan.tasks[t].span];
    const LayerHeader& layer = file.header().layers[span.layer];
    end = t + 1;
    while (end < plan.tasks.size() && plan.tasks[end].span == plan.tasks[t].span) ++end;
    const uint64_t key = key_of(span.layer, span.bucket);
    if (std::binary_search(listed_buckets_.begin(), listed_buckets_.end(), key)) continue;
    listed.push_back(key);
    begin_item(span.layer, span.bucket, ladder_.rung_of_tier(layer.tier), HUGE_VAL, -HUGE_VAL);
    Item item = items_.back();
    const double unit = span.width / 64;
    for (size_t k = t; k < end; ++k) {
      const PageTask& task = plan.tasks[k];
      item.begin = std::min(item.begin, span.center + (task.record.visible_begin - 128) * unit);
      item.end = std::max(item.end, span.center + (task.record.visible_end - 128) * unit);
      item.units += task.record.num_gaussians;
      add(task.record.chunk, ChunkKind::kPage, item.rung);
      if (!splits) add(task.record.sh_detail, ChunkKind::kPage, item.rung);
      const BlockRecord* const block = task.block();
      if (block == nullptr || (k > t && plan.tasks[k - 1].block() == block)) continue;
      for (const RcqTableRef& table : block->tables) {
        if (table.num_entries > 0) add(table.chunk, ChunkKind::kPage, item.rung);
      }
    }
    if (layer.permanent) {
      item.begin = -HUGE_VAL;
      item.end = HUGE_VAL;
    }
    item.num_base = items_.back().num_base;
    for (size_t k = t; k < end && splits; ++k) {
      add(plan.tasks[k].record.sh_detail, ChunkKind::kPage, top);
    }
    item.num_detail = items_.back().num_base - item.num_base;
    items_.back() = item;
  }
  std::sort(listed.begin(), listed.end());
  listed_buckets_.swap(listed);
  return {};
}

Status StreamMap::rebuild(const std::vector<Interval>& intervals, uint32_t levels, double now,
                          std::vector<ChunkEvent>* events) {
  old_.swap(chunks_);
  chunks_.clear();
  items_.clear();
  refs_.clear();
  listed_pages_.clear();
  listed_buckets_.clear();
  is_stale_ = false;
  is_partial_ = true;
  add_headers();
  Status status;
  if (is_open_) {
    add_tables();
    l4d_query query = L4D_INIT(l4d_query);
    query.kind = L4D_QUERY_RANGE;
    query.point.levels = levels;
    query.whole_buckets = 1;
    for (const Interval& interval : intervals) {
      query.time_begin = interval.begin;
      query.time_end = interval.end;
      QueryBuckets buckets;
      status = find_query_buckets(decoder_.file().header(), query, &buckets);
      if (!status.ok()) break;
      for (const BucketRun& run : buckets.runs) {
        const unsigned bits = decoder_.file().header().layers[run.layer].directory_bits;
        for (uint32_t d = run.buckets.first >> bits; d <= run.buckets.last >> bits; ++d) {
          if (chunks_.size() >= kMostChunks) break;
          add_directory(run.layer, d, now, events);
        }
      }
      status = add_pages(query);
      if (status.ok() && chunks_.size() >= kMostChunks) {
        status = Status(L4D_ERR_LIMIT_EXCEEDED, "the path needs too many chunks");
      }
      if (!status.ok()) break;
    }
    add_whole_directory(now, events);
  }
  finish(now, events);
  is_partial_ = false;
  return status;
}

// Sorts the chunks, and hands over what was known of them.
void StreamMap::finish(double now, std::vector<ChunkEvent>* events) {
  std::vector<uint32_t> order(chunks_.size()), place(chunks_.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    return chunks_[a].offset != chunks_[b].offset ? chunks_[a].offset < chunks_[b].offset : a < b;
  });
  std::vector<Chunk> sorted;
  sorted.reserve(chunks_.size());
  for (const uint32_t i : order) {
    const Chunk& chunk = chunks_[i];
    if (sorted.empty() || sorted.back().offset != chunk.offset) sorted.push_back(chunk);
    sorted.back().rung = std::min(sorted.back().rung, chunk.rung);
    place[i] = static_cast<uint32_t>(sorted.size() - 1);
  }
  for (uint32_t& ref : refs_) ref = place[ref];
  chunks_.swap(sorted);
  longest_ = 0;
  auto known = old_.begin();
  for (Chunk& chunk : chunks_) {
    longest_ = std::max<uint64_t>(longest_, chunk.size);
    while (known != old_.end() && known->offset < chunk.offset) ++known;
    if (known != old_.end() && known->offset == chunk.offset && known->size == chunk.size &&
        known->hash == chunk.hash) {
      chunk.gap = known->gap;
      chunk.right = known->right;
    }
    if (chunk.offset > most_bytes() || chunk.size > most_bytes() - chunk.offset) {
      lose(chunk, L4D_CAUSE_TRUNCATED, now, events);
    } else {
      check_one(&chunk, now, events);
    }
  }
  old_.clear();
}

void StreamMap::refresh(bool tolerant) {
  for (Chunk& chunk : chunks_) chunk.lost = false;
  for (const Ledger::Entry& entry : ledger_.entries()) {
    if (!entry.lost) continue;
    const auto it = lower_bound_of(chunks_, entry.offset);
    if (it != chunks_.end() && it->offset == entry.offset && !it->right) it->lost = true;
  }
  const auto is_here = [&](size_t ref) {
    const Chunk& chunk = chunks_[refs_[ref]];
    return chunk.right || (tolerant && chunk.lost);
  };
  const uint32_t top = ladder_.size() - 1;
  for (Item& item : items_) {
    item.lacks = Item::kAllHere;
    const size_t detail = item.first + item.num_base;
    for (size_t r = item.first; r < detail && item.lacks > item.rung; ++r) {
      if (!is_here(r)) item.lacks = item.rung;
    }
    for (size_t r = detail; r < detail + item.num_detail && item.lacks > top; ++r) {
      if (!is_here(r)) item.lacks = top;
    }
  }
}

}  // namespace l4d::playback
