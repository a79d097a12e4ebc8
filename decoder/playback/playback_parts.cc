// SPDX-License-Identifier: Apache-2.0
// The streams of the path: how they are opened, lost, found again and closed.
#include <algorithm>
#include <cmath>

#include "decoder/playback/playback.h"

namespace l4d::playback {
namespace {

constexpr int kMostOpenings = 8;      // in which parts of a stream may name each other
constexpr size_t kMostIdleParts = 8;  // that are open and not on the path
constexpr uint32_t kMostPassedOver = 16;

uint32_t cause_of(l4d_status status) {
  switch (status) {
    case L4D_ERR_NOT_L4D:
      return L4D_CAUSE_NOT_L4D;
    case L4D_ERR_VERSION_UNSUPPORTED:
      return L4D_CAUSE_VERSION;
    case L4D_ERR_FEATURE_UNSUPPORTED:
      return L4D_CAUSE_FEATURE;
    case L4D_ERR_LIMIT_EXCEEDED:
      return L4D_CAUSE_LIMIT;
    case L4D_ERR_TRUNCATED:
      return L4D_CAUSE_TRUNCATED;
    default:
      return L4D_CAUSE_CORRUPT;
  }
}

}  // namespace

// ---- lost and found

void Playback::tell_closed(const Part& part) {
  while (const Residents::Bucket* const bucket = residents_.find_any(part.slot)) {
    unload(*bucket);
  }
  add_event(L4D_EVENT_CLOSED, 0, L4D_CAUSE_NONE, 0);
  queue_.back().stream = part.entry.number;
}

void Playback::close_part(Part* part) {
  cancel_all(part);
  tell_closed(*part);
  presentation_.free_part(part);
}

// A member that cannot be had costs no more than its span.
void Playback::lose_part(Part* part, uint32_t cause, double retry_at) {
  cancel_all(part);
  const bool known = part->told_lost;
  if (!known) {
    add_event(L4D_EVENT_LOST, 0, cause, 0);
    queue_.back().stream = part->entry.number;
  }
  part->told_lost = true;
  part->lost = cause;
  part->failures = 0;
  const double delay = lost_delay(part->losses);
  if (part->losses < 10) ++part->losses;
  part->retry_at = retry_at < 0 ? now_ + delay : retry_at;
  bytes_changed_ = sorts_ = true;
  wake_at_ = now_;
}

void Playback::seek_part_again(Part* part) {
  if (!part->is_lost()) return;
  if (part->lost == L4D_CAUSE_CHANGED) {
    tell_closed(*part);
    planner_.forget_order();
    presentation_.renew(part);
    part->told_lost = false;
  }
  part->lost = L4D_CAUSE_NONE;
  if (const Ledger::Entry* const lost = part->map.lost_header()) {
    part->ledger.retry(lost->offset, now_);
  }
  part->map.set_stale();
  bytes_changed_ = sorts_ = true;
  wake_at_ = now_;
}

// retry_at: below 0: later and later.
void Playback::fail_source(Part* part, uint32_t cause, double retry_at) {
  if (presentation_.is_playlist()) {
    lose_part(part, cause, retry_at);
  } else {
    fail_stream(cause, retry_at < 0 ? now_ + lost_delay(0) : retry_at);
  }
}

// ---- what is on the path

void Playback::begin_playback() {
  has_begun_ = true;
  set_path_range();
  Position& at = clock_.position;
  const bool has_target = current_.active || has_position_;
  if (has_target) {
    at.time = clamped(current_.active ? current_.time : at.time);
  } else if (path_.grows() && at.direction > 0) {
    at.time = clamped(HUGE_VAL);
  } else {
    at.time = at.direction > 0 ? path_.begin() : path_.end();
  }
  follows_ = live_.delay(now_, at.time) <= live_.max_distance(now_);
  current_.time = clamped(current_.time);
  next_.time = clamped(next_.time);
  clock_.set_anchor(now_);
  chosen_at_ = -HUGE_VAL;
}

// The first stream of what is shown first is here, or is lost.
void Playback::on_opened() {
  set_stream(link_.is_down() ? L4D_STREAM_DEGRADED : L4D_STREAM_OPEN, L4D_CAUSE_NONE);
}

// Of a playlist: what is lost at its begin is passed over.
void Playback::open_first() {
  if (stream_ != L4D_STREAM_OPENING || !has_begun_) return;
  const size_t stage = presentation_.media_at(clock_.position.time);
  presentation_.find_parts(stage, &stage_);
  bool opens = false, lost = true;
  for (const Part* part : stage_) {
    opens = opens || part == nullptr || (!part->is_open() && !part->is_lost());
    lost = lost && part != nullptr && part->is_lost();
  }
  if (opens) return;
  if (!lost) {
    on_opened();
    return;
  }
  const bool may_pass = settings_.tolerant && !has_position_ && clock_.position.direction > 0;
  if (may_pass && passed_over_ < kMostPassedOver && stage + 1 < presentation_.num_media()) {
    ++passed_over_;
    jump_to(presentation_.media(stage + 1).begin);
    return;
  }
  fail_stream(stage_[0]->lost, stage_[0]->retry_at);
}

// Brings the maps to the path. Returns whether all of it may be looked at further.
bool Playback::follow_parts(bool* changed) {
  bool some = false;
  const Status followed =
      planner_.follow(on_path_, settings_, presentation_.num_rungs(), now_, &some, &chunk_events_);
  *changed = *changed || some;
  add_chunk_events();
  if (!followed.ok()) {
    fail_stream(cause_of(followed.code()), HUGE_VAL);
    return false;
  }
  for (Part* part : on_path_) {
    if (part->is_lost()) continue;
    if (!part->is_open()) {
      const Status opened = part->map.try_open(now_);
      if (!opened.ok()) {
        const Ledger::Entry* const lost = part->map.lost_header();
        fail_source(part, cause_of(opened.code()), lost == nullptr ? HUGE_VAL : lost->at);
        if (stream_ == L4D_STREAM_FAILED) return false;
        continue;
      }
      if (!part->is_open()) continue;
      presentation_.meet(*part);
      rate_.set_num_rungs(presentation_.num_rungs());
      part->set_open();
      *changed = true;
      if (!presentation_.is_playlist()) {
        presentation_.set_stream_span(part->sequence.begin, part->sequence.end);
        begin_playback();
        on_opened();
        continue;
      }
      add_event(L4D_EVENT_OPENED, 0, L4D_CAUSE_NONE, 0);
      queue_.back().stream = part->entry.number;
    }
    if (part->is_open() && part->told_lost) {
      part->told_lost = false;
      add_event(L4D_EVENT_FOUND, 0, L4D_CAUSE_NONE, 0);
      queue_.back().stream = part->entry.number;
    }
  }
  return true;
}

// By its ladder, which is another one once it is open, and the quality.
void Playback::set_limit(Part* part) const {
  const Ladder& ladder = part->map.ladder();
  part->limit = std::min(ladder.highest_within(quality_.point), ladder.size() - 1);
}

// Returns whether something of the path is another one.
bool Playback::follow() {
  bool changed = false;
  for (const auto& part : presentation_.parts()) {
    if (!part->map.is_unchecked()) continue;
    part->map.check(0, UINT64_MAX, now_, &chunk_events_);
    bytes_changed_ = true;
  }
  for (int round = 0; round < kMostOpenings; ++round) {
    path_.segments(clock_.position, settings_.path_length(), &segments_);
    presentation_.lay(segments_, &on_path_);
    for (Part* part : on_path_) set_limit(part);
    settings_.position = clock_.position;
    if (!follow_parts(&changed)) return changed;
    const double before = clock_.position.time;
    open_first();
    const bool stale = std::any_of(on_path_.begin(), on_path_.end(),
                                   [](const Part* part) { return part->map.is_stale(); });
    if (!stale && before == clock_.position.time) break;
  }
  for (Part* part : on_path_) {
    const Ledger::Entry* const lost = part->map.lost_header();
    if (lost == nullptr || part->is_lost()) continue;
    // A file of another kind is the same each time, which damage is too.
    const l4d_status status = part->map.header_status();
    const bool other =
        status != L4D_OK && (lost->cause == L4D_CAUSE_DAMAGED || lost->cause == L4D_CAUSE_CORRUPT);
    const double at = lost->at;
    fail_source(part, other ? cause_of(status) : lost->cause, at);
  }
  close_unused();
  if (changed) {
    choose_rungs();  // of ladders that nobody knew before
    planner_.set_rungs(settings_);
  }
  return changed;
}

// Streams off the path keep what they have, but for decoded buckets. Those that were on it longest
// ago are closed.
void Playback::close_unused() {
  size_t idle = 0;
  for (const auto& part : presentation_.parts()) {
    if (part->is_on_path()) continue;
    ++idle;
    if (part->is_open() && !part->decoder.slicer().cache().is_empty()) {
      part->decoder.slicer().close();
    }
  }
  while (idle > kMostIdleParts) {
    Part* oldest = nullptr;
    for (const auto& part : presentation_.parts()) {
      if (part->is_on_path() || (oldest != nullptr && oldest->last_use <= part->last_use)) continue;
      oldest = part.get();
    }
    close_part(oldest);
    --idle;
  }
}

}  // namespace l4d::playback
