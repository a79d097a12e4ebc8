// SPDX-License-Identifier: Apache-2.0
#include "tests/playback/session_rules.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <sstream>

namespace l4d::playback::test {
namespace {

uint64_t bits_of(double value) {
  uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}

}  // namespace

uint32_t SessionRules::new_seek() {
  open_seeks_.insert(++last_seek_);
  moved_ = true;
  return last_seek_;
}

void SessionRules::request_ended(uint32_t id) {
  // It may end while a CANCEL for it waits in the queue.
  require(open_requests_.erase(id) == 1 || ended_.count(id) == 1,
          "I9: a request that nobody made has ended");
  ended_.insert(id);
}

// I4: nothing that is here, or on its way, is requested.
void SessionRules::take_request(const l4d_playback_item& item) {
  require(item.id > last_request_, "I9: the id of a request comes again");
  last_request_ = item.id;
  open_requests_.insert(item.id);
  require(last_request_ < 3000, "requests without an end");
  require(open_requests_.size() <= options_.max_requests, "more requests than are allowed");
  if ((item.flags & (L4D_REQUEST_FRESH | L4D_REQUEST_WHOLE)) != 0) return;
  const Part* const part = part_of(item.source);
  require(part != nullptr, "a request of an unknown source");
  if (part == nullptr) return;
  const uint64_t begin = item.offset - part->entry.offset, end = begin + item.size;
  require(item.size > 0, "a request without bytes");
  require(part->entry.bytes == 0 || end <= part->entry.bytes,
          "a request reaches beyond its member");
  require(part->blocks.gap_begin(begin, end) == begin && part->blocks.gap_end(begin, end) == end,
          "I4: a byte that is held is requested");
  for (const Request& other : engine_.link().requests()) {
    if (other.id == item.id || other.fresh || other.whole || other.part != part) continue;
    require(other.end <= begin || other.at >= end, "I4: a byte is in two requests");
  }
}

const Part* SessionRules::part_of(uint32_t source) const {
  const bool is_playlist = engine_.presentation().is_playlist();
  return engine_.presentation().find(is_playlist ? source - 1 : 0);
}

void SessionRules::take_event(const l4d_playback_item& item) {
  const std::array<uint64_t, 3> chunk{item.stream, item.offset, item.size == 0 ? 0u : 1u};
  switch (item.event) {
    case L4D_EVENT_SHOWN:
    case L4D_EVENT_REPLACED:
    case L4D_EVENT_FAILED:
      moved_ = true;
      require(open_seeks_.erase(item.id) == 1, "I7: a seek has two events");
      (item.event == L4D_EVENT_SHOWN      ? result_.shown
       : item.event == L4D_EVENT_REPLACED ? result_.replaced
                                          : result_.failed) += 1;
      require(item.event != L4D_EVENT_FAILED || item.cause != L4D_CAUSE_NONE,
              "I7: a seek fails without a cause");
      break;
    case L4D_EVENT_LOST:
      require(lost_[chunk] == 0, "I10: a chunk is lost twice");
      require(item.cause != L4D_CAUSE_NONE, "a chunk is lost without a cause");
      lost_[chunk] = 1;
      ++result_.lost;
      break;
    case L4D_EVENT_FOUND:
      require(lost_[chunk] == 1, "I10: a chunk is found that was not lost");
      lost_[chunk] = 0;
      ++result_.found;
      break;
    case L4D_EVENT_SOURCE_DOWN:
      require(!is_down_, "I10: a source goes down twice");
      is_down_ = true;
      ++result_.downs;
      break;
    case L4D_EVENT_SOURCE_UP:
      require(is_down_, "I10: a source comes up twice");
      is_down_ = false;
      break;
    case L4D_EVENT_WRAPPED:
      moved_ = true;
      break;
    case L4D_EVENT_JUMPED:
      moved_ = true;
      ++result_.jumps;
      break;
    case L4D_EVENT_LIVE:
      moved_ = true;
      if (item.value == double{L4D_LIVE_RESTARTED}) ++result_.restarts;
      break;
    case L4D_EVENT_OPENED:
      require(open_streams_.insert(item.stream).second, "a member is opened twice");
      ++result_.opened;
      break;
    case L4D_EVENT_CLOSED:
      open_streams_.erase(item.stream);
      for (auto& known : lost_) {
        if (known.first[0] == item.stream) known.second = 0;
      }
      break;
    case L4D_EVENT_STREAM:
      // Another version has chunks of its own.
      if (item.cause == L4D_CAUSE_CHANGED) lost_.clear();
      break;
    default:
      break;
  }
}

void SessionRules::take(const l4d_playback_item& item) {
  for (const uint64_t v :
       {uint64_t{item.kind}, uint64_t{item.id}, uint64_t{item.flags}, item.offset, item.size,
        uint64_t{item.source}, uint64_t{item.stream}, uint64_t{item.layer}, uint64_t{item.bucket},
        uint64_t{item.detail}, item.units, uint64_t{item.event}, uint64_t{item.cause},
        bits_of(item.time), bits_of(item.value)}) {
    mix(v);
  }
  if (item.kind == L4D_ITEM_REQUEST) take_request(item);
  if (item.kind == L4D_ITEM_CANCEL) request_ended(item.id);
  if (item.kind == L4D_ITEM_EVENT) take_event(item);
  if (item.kind == L4D_ITEM_LOAD) {
    require(item.id > last_load_, "I9: the id of a load comes again");
    last_load_ = item.id;
  }
}

// I6: the time stays within what is ready, and moves as fast as it says.
void SessionRules::check_time(double now) {
  const l4d_playback_state s = engine_.state();
  if (s.motion == L4D_MOTION_PLAYING) {
    require(s.ready != 0, "I6: plays what is not ready");
    require(s.anchor_time >= s.ready_from && s.anchor_time <= s.ready_until,
            "I6: the time has left what is ready");
    require(s.anchor_now <= now, "I6: the anchor is in the future");
  } else {
    require(s.velocity == 0, "I6: moves and does not play");
  }
}

// It moves as fast as it says, unless a seek or a border comes between.
void SessionRules::check_speed() {
  const l4d_playback_state s = engine_.state();
  if (has_last_ && !moved_ && last_.motion == L4D_MOTION_PLAYING &&
      s.motion == L4D_MOTION_PLAYING && s.velocity == last_.velocity && s.waits == last_.waits) {
    const double moved = s.anchor_time - last_.anchor_time;
    const double expected = (s.anchor_now - last_.anchor_now) * s.velocity;
    require(std::fabs(moved - expected) < 1e-6 * (1 + std::fabs(expected)),
            "I6: the time does not move as fast as it says: " + std::to_string(moved) + " for " +
                std::to_string(expected));
  }
  last_ = s;
  has_last_ = true;
  moved_ = false;
}

void SessionRules::check_memory() {
  const uint64_t pool = engine_.blocks().capacity_bytes();
  require(engine_.blocks().memory_bytes() <= pool + pool / 16, "I5: the pool is too large");
  require(engine_.residents().units() <= options_.max_units, "I5: the store is too full");
}

void SessionRules::check_chunk(const Part& part, const Chunk& chunk, double now, double wake_at) {
  if (chunk.right || chunk.lost || chunk.end() > part.map.most_bytes()) return;
  const std::vector<Request>& requests = engine_.link().requests();
  bool under_way = false;
  for (const Request& r : requests) {
    if (r.part != &part) continue;
    under_way = under_way || r.whole || (r.at < chunk.end() && r.end > chunk.offset);
  }
  const Ledger::Entry* const entry = part.ledger.find(chunk.offset);
  const bool waits = entry != nullptr && (entry->lost || entry->at > now);
  const bool held = engine_.link().hold_until() > now;
  const bool slots = !engine_.link().has_slot();
  if (under_way || slots || wake_at < now + 0.002) return;
  if ((waits || held) && wake_at < HUGE_VAL) return;
  if (waits && entry->lost && entry->cause != L4D_CAUSE_NONE) return;
  std::ostringstream what;
  what << "I1: chunk at " << chunk.offset << " of " << chunk.size << " (kind "
       << static_cast<int>(chunk.kind) << ", order " << (chunk.order >> 56) << ", gap "
       << chunk.gap - chunk.offset << ") is neither under way nor scheduled nor lost; entry "
       << (entry != nullptr) << " now " << now << " wake " << wake_at;
  require(false, what.str());
}

// I1: what the instant lacks is under way, scheduled, to be loaded, or lost with a cause.
void SessionRules::check_instant(double now) {
  const l4d_playback_state s = engine_.state();
  if (s.stream == L4D_STREAM_FAILED) {
    require(s.cause != L4D_CAUSE_NONE, "I1: failed without a cause");
    return;
  }
  for (const Part* part : engine_.planner().parts()) {
    if (part->is_lost()) {
      require(part->lost != L4D_CAUSE_NONE, "I1: a member is lost without a cause");
      continue;
    }
    if (!part->is_on_path() || part->segments[0].at > 0) continue;
    for (const Item& item : part->map.items()) {
      if (item.hidden > part->rung_of(engine_.floor_rung())) continue;
      if (!item.is_visible(part->segments[0].from)) continue;
      if (item.is_bucket() && item.lacks == Item::kAllHere) continue;  // it waits to be loaded
      for (size_t r = item.first; r < item.first + item.num_base; ++r) {
        check_chunk(*part, part->map.chunks()[part->map.refs()[r]], now, s.wake_at);
      }
    }
  }
}

void SessionRules::after_call(double now) {
  check_time(now);
  check_memory();
}

void SessionRules::after_update(double now, bool something) {
  const l4d_playback_state s = engine_.state();
  check_speed();
  require(s.wake_at > now, "I3: the deadline has passed");
  idle_updates_ = something ? 0 : idle_updates_ + 1;
  // Five cells, five choices and what else there is in a second; the bound is generous.
  if (idle_updates_ >= 400 && ok()) {
    std::ostringstream what;
    what << "I3: calls that change nothing: now " << now << " wake " << s.wake_at << " stream "
         << s.stream << " motion " << s.motion << " live " << s.live << " hold "
         << engine_.link().hold_until() << " look " << engine_.live().look_at() << " live next "
         << engine_.live().next_time(now);
    for (const auto& part : engine_.presentation().parts()) {
      what << " part " << part->entry.number << " lost " << part->lost << " at " << part->retry_at
           << " next " << part->ledger.next_time(now);
    }
    require(false, what.str());
  }
  if (something && has_network_) check_instant(now);
}

void SessionRules::end(bool seeks_end) {
  require(!seeks_end || open_seeks_.empty(), "I7: a seek has no event");
  require(open_requests_.size() == engine_.link().requests().size(), "I9: requests do not add up");
}

}  // namespace l4d::playback::test
