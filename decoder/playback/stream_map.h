// SPDX-License-Identifier: Apache-2.0
// Which chunks of a stream the instants of a path need, and which of them are here and right. A
// chunk is the unit of a hash; an item is what becomes visible at once: a bucket, a page of the
// directory, the tables of a layer.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "decoder/playback/blocks.h"
#include "decoder/playback/ledger.h"
#include "decoder/playback/rungs.h"
#include "decoder/session/decoder.h"

namespace l4d::playback {

enum class ChunkKind : uint8_t { kFileHeader, kSceneHeader, kTable, kPageEntry, kDirectory, kPage };

struct Chunk {
  uint64_t offset = 0;
  uint64_t hash = 0;            // unless it checks itself: kFileHeader, kPageEntry
  uint64_t gap = 0;             // all bytes of it before are here
  uint64_t order = UINT64_MAX;  // of requests; see Planner
  uint32_t size = 0;
  uint32_t layer = 0, index = 0;  // kDirectory
  uint32_t rung = 0;              // the lowest one that needs it
  ChunkKind kind = ChunkKind::kPage;
  bool right = false;
  bool lost = false;     // in the ledger
  bool on_path = false;  // some item of the path needs it
  uint64_t end() const { return offset + size; }
};

struct Item {
  static constexpr uint32_t kNoBucket = UINT32_MAX;
  static constexpr uint32_t kAllHere = UINT32_MAX;
  double begin = 0, end = 0;  // when some of it is visible
  uint32_t layer = 0, bucket = kNoBucket;
  uint32_t rung = 0;                               // of its base chunks
  size_t first = 0, num_base = 0, num_detail = 0;  // in refs(); detail follows base
  uint64_t units = 0;
  double distance = 0;         // along the path; infinity: not on it
  uint32_t lacks = kAllHere;   // the lowest rung for which bytes lack
  uint32_t hidden = kAllHere;  // the lowest rung that cannot be shown because of it
  bool loaded = false;         // the caller has all that is wanted of it
  bool is_bucket() const { return bucket != kNoBucket; }
  bool is_visible(double time) const { return begin <= time && time <= end; }
};

struct Interval {
  double begin = 0, end = 0;
};

// What became of a chunk whose bytes were looked at.
struct ChunkEvent {
  uint32_t event = 0;  // L4D_EVENT_LOST or _FOUND
  uint32_t cause = 0;
  uint32_t stream = 0;
  uint64_t offset = 0, size = 0;
};

class StreamMap {
 public:
  // stream: its number in events.
  StreamMap(Decoder& decoder, FileBlocks& blocks, Ledger& ledger, uint32_t stream)
      : decoder_(decoder), blocks_(blocks), ledger_(ledger), stream_(stream) {}

  // A file of which nothing is known but its size, UINT64_MAX = not known.
  void open(uint64_t file_size);
  void set_file_size(uint64_t bytes);
  uint64_t file_size() const { return file_size_; }
  // Chunks end there, or are lost.
  uint64_t most_bytes() const { return std::min(file_size_, FileBlocks::kMostBytes); }
  bool is_open() const { return is_open_; }
  const Ladder& ladder() const { return ladder_; }

  // Looks at chunks of which bytes in [begin, end) have arrived. Where one is wrong, the ledger
  // knows.
  void check(uint64_t begin, uint64_t end, double now, std::vector<ChunkEvent>* events);
  // Bytes are about to arrive. Where memory runs out before check() has looked at them, all chunks
  // are to be looked at.
  void expect_check() { is_unchecked_ = true; }
  bool is_unchecked() const { return is_unchecked_; }
  // Opens the decoder when the headers are here. Fails where they are right and cannot be used.
  Status try_open(double now);
  // Whether the map names less than it could: chunks have come that name others.
  bool is_stale() const { return is_stale_ || is_partial_; }
  void set_stale() { is_stale_ = true; }
  // Names the chunks of disjoint intervals. Chunks that were known keep what is known of them.
  Status rebuild(const std::vector<Interval>& intervals, uint32_t levels, double now,
                 std::vector<ChunkEvent>* events);
  // Brings Chunk::lost and Item::lacks up to date. tolerant: what is lost counts as here.
  void refresh(bool tolerant);
  // Of the parser, if the file header or the scene header is wrong.
  l4d_status header_status() const { return header_status_; }
  // The header whose loss keeps the stream closed; null where there is none.
  const Ledger::Entry* lost_header() const;

  std::vector<Chunk>& chunks() { return chunks_; }
  const std::vector<Chunk>& chunks() const { return chunks_; }
  std::vector<Item>& items() { return items_; }
  const std::vector<Item>& items() const { return items_; }
  const std::vector<uint32_t>& refs() const { return refs_; }
  // The first chunk that may reach beyond `offset`.
  size_t first_chunk_at(uint64_t offset) const;

 private:
  void finish(double now, std::vector<ChunkEvent>* events);
  void check_one(Chunk* chunk, double now, std::vector<ChunkEvent>* events);
  bool is_right(const Chunk& chunk, uint64_t* hash);
  void lose(const Chunk& chunk, uint32_t cause, double now, std::vector<ChunkEvent>* events);
  void add(const ChunkRef& chunk, ChunkKind kind, uint32_t rung, uint32_t layer = 0,
           uint32_t index = 0);
  void add_headers();
  void add_tables();
  void add_directory(uint32_t layer, uint32_t index, double now, std::vector<ChunkEvent>* events);
  void add_whole_directory(double now, std::vector<ChunkEvent>* events);
  Status add_pages(const l4d_query& query);
  void begin_item(uint32_t layer, uint32_t bucket, uint32_t rung, double begin, double end);
  bool is_known_right(uint64_t offset) const;

  Decoder& decoder_;
  FileBlocks& blocks_;
  Ledger& ledger_;
  uint32_t stream_;
  uint64_t file_size_ = UINT64_MAX;
  bool is_open_ = false;
  bool is_stale_ = true;
  bool is_unchecked_ = false;
  bool is_partial_ = false;  // memory ran out while it was made
  FileHeader file_header_;
  l4d_status header_status_ = L4D_OK;
  Ladder ladder_;
  std::vector<Chunk> chunks_;  // ascending by offset
  std::vector<Chunk> old_;     // of the map before
  std::vector<Item> items_;
  std::vector<uint32_t> refs_;
  uint64_t longest_ = 0;                                 // of the chunks
  std::vector<uint64_t> listed_pages_, listed_buckets_;  // in the map already, ascending
  Bytes scratch_;
};

}  // namespace l4d::playback
