// SPDX-License-Identifier: Apache-2.0
// Which requests Playback makes and takes back.
#include <algorithm>
#include <cmath>

#include "decoder/playback/playback.h"

namespace l4d::playback {
namespace {

// A request that is nearly done is not worth cancelling.
constexpr uint64_t kNearlyDoneBytes = 64 << 10;
constexpr double kNearlyDoneSeconds = 0.1;
// What is not urgent waits while so many seconds of bytes are under way.
constexpr double kQueuedSeconds = 2;
constexpr uint64_t kMergeGap = 16 << 10, kUrgentMergeGap = 64 << 10;
constexpr uint64_t kRangeBytes = 1 << 20;

}  // namespace

bool Playback::is_urgent(Urgency urgency) const {
  const bool waits =
      !has_begun_ || current_.active || !ready_.ready || clock_.motion == L4D_MOTION_WAITING;
  return waits && urgency <= Urgency::kStart;
}

// Whether playback has so little left that other bytes go first.
bool Playback::comes_too_late(const Part& part, Urgency urgency, uint32_t rung) const {
  if (urgency < Urgency::kPath || rung <= part.rung_of(settings_.floor)) return false;
  if (choice_.cancel == RateCancel::kAllButBase) return true;
  const Ladder& ladder = part.map.ladder();
  return choice_.cancel == RateCancel::kDetail && ladder.has_detail && rung == ladder.size() - 1 &&
         part.rung_of(settings_.target) < rung;
}

void Playback::cancel_unwanted() {
  const bool scrubs = search_ == L4D_SEARCH_SCRUBBING;
  for (size_t i = link_.requests().size(); i > 0; --i) {
    const Request request = link_.requests()[i - 1];
    if (request.part == nullptr || (request.whole && request.part->is_on_path())) continue;
    if (request.fresh && !request.whole) {
      if (request.part->ledger.find(request.chunk) == nullptr) cancel(request.id);
      continue;
    }
    const bool late = comes_too_late(*request.part, request.urgency, request.rung);
    if (!late && planner_.is_wanted(*request.part, request.at, request.end,
                                    scrubs ? Urgency::kInstant : Urgency::kIdle)) {
      continue;
    }
    const uint64_t left = request.end - std::min(request.at, request.end);
    const double seconds =
        choice_.throughput > 0 ? static_cast<double>(left) / choice_.throughput : HUGE_VAL;
    if (left > kNearlyDoneBytes || seconds > kNearlyDoneSeconds) cancel(request.id);
  }
}

void Playback::add_request(const WantedRange& range) {
  const bool urgent = is_urgent(range.urgency);
  reserve_item();
  const Part* const part = range.part;
  const bool whole = part == nullptr || part->no_ranges;
  const Request& request = link_.start(range, whole, urgent, now_, choice_.throughput);
  l4d_playback_item& item = add_item(L4D_ITEM_REQUEST);
  item.id = request.id;
  if (presentation_.is_playlist() && part != nullptr) item.source = part->entry.number + 1;
  item.flags = (request.fresh ? uint32_t{L4D_REQUEST_FRESH} : 0u) |
               (request.whole ? uint32_t{L4D_REQUEST_WHOLE} : 0u) |
               (urgent ? uint32_t{L4D_REQUEST_URGENT} : 0u) |
               (part == nullptr ? uint32_t{L4D_REQUEST_PLAYLIST} : 0u);
  item.offset = request.begin + (part != nullptr ? part->entry.offset : 0);
  item.size = request.end == UINT64_MAX ? 0 : request.end - request.begin;
  item.needed_at = now_ + range.step * Planner::kCellSeconds / std::max(clock_.speed(), 1e-3);
}

// Late decisions beat early queues, and what the picture waits for has the link for itself.
bool Playback::waits_its_turn(Urgency urgency) const {
  const double seconds = choice_.throughput > 0
                             ? static_cast<double>(link_.bytes_under_way()) / choice_.throughput
                             : HUGE_VAL;
  if (urgency > Urgency::kInstant && !ready_.ready && seconds > kNearlyDoneSeconds) {
    for (const Request& request : link_.requests()) {
      if (request.urgency <= Urgency::kInstant) return true;
    }
  }
  return urgency >= Urgency::kPath && choice_.throughput > 0 && seconds > kQueuedSeconds;
}

void Playback::add_requests() {
  waits_until_ = HUGE_VAL;
  if (reader_.read_at != nullptr || stream_ == L4D_STREAM_FAILED) return;
  add_list_request();
  while (link_.has_slot() && has_room()) {
    link_.list_under_way(&under_way_);
    RangeShape shape;
    shape.merge_gap = choice_.merge_gap > 0 ? choice_.merge_gap : kMergeGap;
    if (is_urgent(Urgency::kInstant)) shape.merge_gap = std::max(shape.merge_gap, kUrgentMergeGap);
    shape.max_bytes = choice_.max_range_bytes > 0 ? choice_.max_range_bytes : kRangeBytes;
    const WantedRange range = planner_.find_wanted(under_way_, shape, now_, &waits_until_);
    if (range.urgency == Urgency::kNone) return;
    if (link_.hold_until() > now_) {
      waits_until_ = std::min(waits_until_, link_.hold_until());
      return;
    }
    const bool has_one = std::any_of(under_way_.begin(), under_way_.end(),
                                     [&](const UnderWay& w) { return w.part == range.part; });
    if (range.part->no_ranges && has_one) return;
    if (waits_its_turn(range.urgency) || comes_too_late(*range.part, range.urgency, range.rung))
      return;
    add_request(range);
  }
}

}  // namespace l4d::playback
