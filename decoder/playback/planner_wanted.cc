// SPDX-License-Identifier: Apache-2.0
// Which bytes Planner would have next.
#include <algorithm>
#include <cmath>

#include "decoder/playback/planner.h"

namespace l4d::playback {
namespace {

// The size of the first read. It holds headers and tables of most files.
constexpr uint64_t kHeadBytes = 65536;

}  // namespace

bool Planner::may_request(Urgency urgency) const {
  if (settings_.network == L4D_NETWORK_NONE) return false;
  if (settings_.network == L4D_NETWORK_METADATA) {
    return urgency <= Urgency::kDirectory || urgency == Urgency::kIdle;
  }
  return !settings_.instant_only || urgency <= Urgency::kInstant;
}

bool Planner::is_wanted(const Part& part, uint64_t begin, uint64_t end, Urgency least) const {
  if (!part.is_on_path() || part.is_lost()) return false;
  const std::vector<Chunk>& chunks = part.map.chunks();
  for (size_t i = part.map.first_chunk_at(begin); i < chunks.size() && chunks[i].offset < end;
       ++i) {
    const Chunk& chunk = chunks[i];
    if (chunk.end() <= begin || chunk.right || chunk.lost || chunk.order == UINT64_MAX) continue;
    if (urgency_in(chunk.order) <= least) return true;
  }
  return begin < FileHeader::kBytes && !part.is_open();
}

void Planner::clip(uint64_t from, uint64_t until, uint64_t* begin, uint64_t* end) {
  if (until <= *begin || from >= *end) return;
  if (from <= *begin) {
    *begin = std::min(until, *end);
  } else {
    *end = from;
  }
}

// Whether a range may go on to `begin` over bytes that nobody wants.
bool Planner::may_bridge(const WantedRange& range, uint64_t begin,
                         const std::vector<UnderWay>& under_way) const {
  if (begin == range.end) return true;
  const FileBlocks& blocks = range.part->blocks;
  if (blocks.fill_mark(range.end) != range.end || blocks.gap_end(range.end, begin) < begin) {
    return false;
  }
  return std::none_of(under_way.begin(), under_way.end(), [&](const UnderWay& way) {
    return way.part == range.part && way.begin < begin && way.end > range.end;
  });
}

// Requests are of whole blocks, so that no two share one.
bool Planner::add_pieces(Part* part, const Chunk& chunk, const std::vector<UnderWay>& under_way,
                         const RangeShape& shape, WantedRange* out) const {
  const uint64_t size = part->map.file_size();
  const uint32_t step = static_cast<uint32_t>(chunk.order >> 32) & kMostSteps;
  const Urgency urgency = urgency_in(chunk.order);
  const FileBlocks& blocks = part->blocks;
  const bool is_new = out->urgency == Urgency::kNone;
  if (!is_new && (out->part != part || out->urgency != urgency || out->step != step)) return false;
  uint64_t until = chunk.end();
  if (chunk.kind == ChunkKind::kFileHeader) until = std::min(std::max(until, kHeadBytes), size);
  const uint64_t limit =
      std::min((until + Blocks::kBlockBytes - 1) / Blocks::kBlockBytes * Blocks::kBlockBytes, size);
  for (uint64_t at = chunk.gap; (at = blocks.gap_begin(at, until)) < until;) {
    uint64_t begin = blocks.fill_mark(at), end = blocks.gap_end(at, limit);
    for (const UnderWay& way : under_way) {
      if (way.part == part) clip(way.begin, way.end, &begin, &end);
    }
    const bool has_begun = out->urgency != Urgency::kNone;
    if (has_begun) clip(out->begin, out->end, &begin, &end);
    // A request may have begun in the middle of a block that was evicted since: what it brings is
    // behind `at` then, and the search goes on behind the gap.
    at = end > at ? end : blocks.gap_end(at, limit);
    if (begin >= end) continue;
    if (!has_begun) {
      *out = {begin, std::min(end, begin + shape.max_bytes), urgency, chunk.rung, false, step, 0,
              part};
      if (out->end < end) return false;
      continue;
    }
    if (begin < out->end || begin - out->end > shape.merge_gap ||
        end - out->begin > shape.max_bytes || !may_bridge(*out, begin, under_way)) {
      return false;
    }
    out->end = end;
    out->rung = std::max(out->rung, chunk.rung);
  }
  return true;
}

WantedRange Planner::find_wanted(const std::vector<UnderWay>& under_way, const RangeShape& shape,
                                 double now, double* next) const {
  WantedRange out;
  *next = HUGE_VAL;
  for (const Wanted& w : order_) {
    Part* const part = parts_[w.part];
    const Chunk& chunk = chunk_of(w);
    const Urgency urgency = urgency_in(chunk.order);
    if (chunk.right || chunk.lost || part->is_lost() || !may_request(urgency)) continue;
    if (chunk.end() > part->map.most_bytes()) continue;  // about to be lost
    const Ledger::Entry* const entry = part->ledger.find(chunk.offset);
    if (entry == nullptr || entry->size != chunk.size || chunk.gap < chunk.end()) {
      if (!add_pieces(part, chunk, under_way, shape, &out)) return out;
      continue;
    }
    if (entry->at > now) {
      *next = std::min(*next, entry->at);
      continue;
    }
    const bool is_under_way =
        std::any_of(under_way.begin(), under_way.end(), [&](const UnderWay& way) {
          return way.part == part && way.fresh && way.begin <= entry->next && entry->next < way.end;
        });
    if (is_under_way || entry->next >= chunk.end()) continue;
    if (out.urgency != Urgency::kNone) return out;
    return {entry->next, chunk.end(), urgency, chunk.rung, true, 0, chunk.offset, part};
  }
  return out;
}

}  // namespace l4d::playback
