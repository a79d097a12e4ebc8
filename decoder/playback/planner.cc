// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/planner.h"

#include <algorithm>
#include <cmath>

namespace l4d::playback {
namespace {

// Of the directory beside the path.
constexpr uint64_t kIdleBytes = 512 << 10;
// Of what a stream has before its header says more.
constexpr uint64_t kUnknownBytes = 64 << 10;
constexpr uint64_t kNoOrder = UINT64_MAX;

uint64_t order_of(Urgency urgency, double distance, bool detail) {
  const double step = std::min(distance / Planner::kCellSeconds, double{Planner::kMostSteps});
  return uint64_t{static_cast<uint32_t>(urgency)} << 56 | static_cast<uint64_t>(step) << 32 |
         uint64_t{detail ? 1u : 0u} << 31;
}

bool same(const std::vector<Interval>& a, const std::vector<Interval>& b) {
  return std::equal(
      a.begin(), a.end(), b.begin(), b.end(),
      [](const Interval& x, const Interval& y) { return x.begin == y.begin && x.end == y.end; });
}

double distance_of(const Item& item, const std::vector<Segment>& segments) {
  double least = HUGE_VAL;
  for (const Segment& s : segments) {
    if (item.begin > s.high() || item.end < s.low()) continue;
    const double from =
        s.forwards() ? std::max(item.begin - s.from, 0.0) : std::max(s.from - item.end, 0.0);
    least = std::min(least, s.at + from);
  }
  return least;
}

}  // namespace

// In the time of the part, from the begin of its span on.
void Planner::find_cells(const Part& part) {
  new_cells_.clear();
  if (!part.is_open()) return;
  const double origin = part.time_of(part.entry.begin);
  for (const Segment& s : part.segments) {
    const double first = std::floor((s.low() - origin) / kCellSeconds);
    const double last = std::max(std::ceil((s.high() - origin) / kCellSeconds), first + 1);
    new_cells_.push_back({origin + first * kCellSeconds, origin + last * kCellSeconds});
  }
  std::sort(new_cells_.begin(), new_cells_.end(),
            [](const Interval& a, const Interval& b) { return a.begin < b.begin; });
  size_t kept = 0;
  for (const Interval& cell : new_cells_) {
    if (kept > 0 && cell.begin <= new_cells_[kept - 1].end) {
      new_cells_[kept - 1].end = std::max(new_cells_[kept - 1].end, cell.end);
    } else {
      new_cells_[kept++] = cell;
    }
  }
  new_cells_.resize(kept);
}

Status Planner::follow(const std::vector<Part*>& parts, const PlanSettings& settings,
                       uint32_t num_rungs, double now, bool* changed,
                       std::vector<ChunkEvent>* events) {
  const bool other_levels = settings.levels != settings_.levels;
  *changed = other_levels || parts != parts_ || num_rungs != ready_.size();
  settings_ = settings;
  if (*changed) {
    order_.clear();
    // num_rungs() is the size of the last one: where memory runs out, the others have no less.
    missing_.assign(std::max<size_t>(num_rungs, missing_.size()), 0);
    wanted_.assign(std::max<size_t>(num_rungs, wanted_.size()), 0);
    ready_.assign(num_rungs, 0);
    parts_ = parts;
  }
  Status status;
  for (Part* part : parts_) {
    find_cells(*part);
    if (other_levels || !same(part->cells, new_cells_) || part->map.is_stale()) {
      *changed = true;
      order_.clear();
      part->cells = new_cells_;
      const Status rebuilt = part->map.rebuild(part->cells, settings_.levels, now, events);
      if (status.ok()) status = rebuilt;
    }
    for (Item& item : part->map.items()) item.distance = distance_of(item, part->segments);
  }
  return status;
}

void Planner::forget_parts() {
  parts_.clear();
  order_.clear();
  ready_.clear();
  missing_.clear();
  wanted_.clear();
}

void Planner::find_states() {
  const uint32_t n = num_rungs();
  ready_.assign(n, HUGE_VAL);
  missing_.assign(n, 0);
  wanted_.assign(n, 0);
  for (const Part* part : parts_) {
    if (part->is_lost() && settings_.tolerant) continue;
    if (!part->is_open()) {
      ready_[0] = std::min(ready_[0], part->segments[0].at);
      if (part->entry.bytes > 0) {
        missing_[0] += std::min<uint64_t>(part->entry.bytes / n, kUnknownBytes);
      }
    }
    // What this stream never shows does not keep others from a rung.
    const auto counts = [&](uint32_t rung) {
      return rung < n && (rung <= part->limit || rung > settings_.top);
    };
    for (const Item& item : part->map.items()) {
      if (counts(item.hidden)) ready_[item.hidden] = std::min(ready_[item.hidden], item.distance);
    }
    for (const Chunk& chunk : part->map.chunks()) {
      if (!chunk.on_path || chunk.right || chunk.lost || !counts(chunk.rung)) continue;
      missing_[chunk.rung] += chunk.size;
      if (chunk.order != kNoOrder) wanted_[chunk.rung] += chunk.size;
    }
  }
  for (uint32_t r = 1; r < n; ++r) {
    ready_[r] = std::min(ready_[r], ready_[r - 1]);
    missing_[r] += missing_[r - 1];
    wanted_[r] += wanted_[r - 1];
  }
}

ReadyInterval Planner::ready_interval(const Part& part, uint32_t rung, double time) const {
  if (part.is_lost() && settings_.tolerant) return {true, -kInfinity, kInfinity};
  ReadyInterval out{false, time, time};
  if (!part.is_open()) return out;
  const auto cell = std::find_if(part.cells.begin(), part.cells.end(), [&](const Interval& c) {
    return c.begin <= time && time <= c.end;
  });
  if (cell == part.cells.end()) return out;
  double from = cell->begin, until = cell->end;
  for (const Item& item : part.map.items()) {
    if (item.hidden > part.rung_of(rung)) continue;
    if (item.is_visible(time)) return out;
    if (item.begin > time) {
      until = std::min(until, std::nextafter(item.begin, -kInfinity));
    } else {
      from = std::max(from, std::nextafter(item.end, kInfinity));
    }
  }
  return {true, from, until};
}

void Planner::find_buffered(const Part& part, uint32_t rung, std::vector<Interval>* out) const {
  out->clear();
  std::vector<Interval> gaps;
  for (const Item& item : part.map.items()) {
    if (item.hidden <= part.rung_of(rung)) gaps.push_back({item.begin, item.end});
  }
  std::sort(gaps.begin(), gaps.end(),
            [](const Interval& a, const Interval& b) { return a.begin < b.begin; });
  for (const Interval& cell : part.cells) {
    double at = cell.begin;
    for (const Interval& gap : gaps) {
      if (gap.end < at || gap.begin > cell.end) continue;
      if (gap.begin > at) out->push_back({at, std::nextafter(gap.begin, -kInfinity)});
      at = std::max(at, std::nextafter(gap.end, kInfinity));
    }
    if (at <= cell.end) out->push_back({at, cell.end});
  }
}

uint32_t Planner::cause_at(const Part& part, uint32_t rung, double time) const {
  if (part.is_lost()) return part.lost;
  for (const Item& item : part.map.items()) {
    if (item.lacks > part.rung_of(rung) || !item.is_visible(time)) continue;
    for (size_t r = item.first; r < item.first + item.num_base + item.num_detail; ++r) {
      const Chunk& chunk = part.map.chunks()[part.map.refs()[r]];
      const Ledger::Entry* const entry = chunk.lost ? part.ledger.find(chunk.offset) : nullptr;
      if (entry != nullptr) return entry->cause;
    }
  }
  return L4D_CAUSE_NONE;
}

// Of a stream that is not shown yet, nothing goes before what is.
Urgency Planner::urgency_ahead(double distance) const {
  return distance < settings_.start_ahead * settings_.rate ? Urgency::kStart : Urgency::kPath;
}

Urgency Planner::urgency_of(const Part& part, const Item& item, uint32_t rung) const {
  const bool on_path = item.distance < HUGE_VAL;
  const bool everywhere = item.begin == -HUGE_VAL && !item.is_bucket();
  const uint32_t target = part.rung_of(settings_.target), fill = part.rung_of(settings_.fill);
  if (!item.is_bucket()) {
    if (rung > fill) return Urgency::kNone;
    if (rung > target) return on_path || everywhere ? Urgency::kFill : Urgency::kNone;
    // The directory comes in items of one entry and one page.
    if (!on_path) return Urgency::kIdle;
    if (part.segments[0].at > 0) return urgency_ahead(item.distance);
    return everywhere ? Urgency::kTables : Urgency::kDirectory;
  }
  if (!on_path) return Urgency::kNone;
  if (rung <= part.rung_of(settings_.floor)) {
    // At the instant: what is visible then begins there.
    const bool at_instant = part.segments[0].at == 0 && item.is_visible(part.segments[0].from);
    if (at_instant) return Urgency::kInstant;
    if (item.distance < settings_.start_ahead * settings_.rate) return Urgency::kStart;
  }
  if (rung <= target) return Urgency::kPath;
  return rung <= fill ? Urgency::kFill : Urgency::kNone;
}

void Planner::set_orders(Part* part) {
  std::vector<Chunk>& chunks = part->map.chunks();
  for (Chunk& chunk : chunks) {
    chunk.order = kNoOrder;
    chunk.on_path = false;
  }
  if (part->is_lost()) return;
  const uint32_t top = part->map.ladder().size() - 1;
  for (const Item& item : part->map.items()) {
    if (item.loaded) continue;
    const size_t detail = item.first + item.num_base;
    for (size_t r = item.first; r < detail + item.num_detail; ++r) {
      Chunk& chunk = chunks[part->map.refs()[r]];
      const bool is_detail = r >= detail;
      const Urgency urgency = urgency_of(*part, item, is_detail ? top : item.rung);
      chunk.on_path = chunk.on_path || item.distance < HUGE_VAL;
      if (urgency == Urgency::kNone) continue;
      const double distance = item.distance < HUGE_VAL ? item.distance : 0;
      chunk.order = std::min(chunk.order, order_of(urgency, distance, is_detail));
    }
  }
}

void Planner::sort() {
  order_.clear();
  for (uint32_t p = 0; p < parts_.size(); ++p) {
    set_orders(parts_[p]);
    const std::vector<Chunk>& chunks = parts_[p]->map.chunks();
    for (uint32_t c = 0; c < chunks.size(); ++c) {
      if (chunks[c].order != kNoOrder) order_.push_back({chunks[c].order, p, c});
    }
  }
  std::sort(order_.begin(), order_.end(), [](const Wanted& a, const Wanted& b) {
    if (a.order != b.order) return a.order < b.order;
    return a.part != b.part ? a.part < b.part : a.chunk < b.chunk;
  });
  cut_to_pool();
}

// What the pool cannot hold together is not wanted: it would be evicted to be fetched again.
void Planner::cut_to_pool() {
  is_cut_ = overflows_ = false;
  // Chunks that follow each other share blocks.
  const auto between = [&](const Wanted& w) -> uint64_t {
    const std::vector<Chunk>& chunks = parts_[w.part]->map.chunks();
    if (w.chunk == 0 || chunks[w.chunk - 1].order == kNoOrder) return Blocks::kBlockBytes;
    const uint64_t at = chunks[w.chunk].offset;
    return std::min(at - std::min(chunks[w.chunk - 1].end(), at), Blocks::kBlockBytes);
  };
  uint64_t bytes = 0, idle_bytes = 0;
  size_t kept = 0;
  for (const Wanted& w : order_) {
    Chunk& chunk = chunk_of(w);
    const uint64_t size = chunk.size + between(w);
    const Urgency urgency = urgency_in(w.order);
    if (urgency == Urgency::kIdle && (idle_bytes += chunk.size) > kIdleBytes) break;
    if (is_cut_ || bytes + size > settings_.pool_bytes) {
      is_cut_ = true;
      overflows_ = overflows_ || urgency <= Urgency::kInstant;
      chunk.order = kNoOrder;
      continue;
    }
    bytes += size;
    order_[kept++] = w;
  }
  order_.resize(kept);
}

void Planner::forget_evicted(Part* part) {
  if (part->evicted == blocks_.num_evicted()) return;
  part->evicted = blocks_.num_evicted();
  for (Chunk& chunk : part->map.chunks()) {
    if (!chunk.right) continue;
    chunk.gap = part->blocks.gap_begin(chunk.offset, chunk.end());
    chunk.right = chunk.gap == chunk.end();
  }
}

void Planner::use_blocks() {
  for (size_t k = order_.size(); k > 0; --k) {
    const Chunk& chunk = chunk_of(order_[k - 1]);
    parts_[order_[k - 1].part]->blocks.use(chunk.offset, chunk.size);
  }
}

}  // namespace l4d::playback
