// SPDX-License-Identifier: Apache-2.0
// What Playback::update decides: rungs, what is shown, whether playback goes on, loads.
#include <algorithm>
#include <cmath>

#include "decoder/playback/playback.h"

namespace l4d::playback {
namespace {

constexpr double kChoiceSeconds = 0.2;  // between two choices of a rung
// Seconds that must be ready of a higher rung before it is shown, and of the shown one to stay.
constexpr double kUpSeconds = 1, kStaySeconds = 0.1;
// Of the pool, for the path: what comes with it over gaps needs the rest.
constexpr double kPathShare = 0.75;
constexpr double kLeastStep = 1e-3;  // seconds between two deadlines
constexpr int kMostRounds = 8;       // in which seeks that wait are served

}  // namespace

uint64_t Playback::bytes_for_path() const {
  const auto& parts = presentation_.parts();
  if (!presentation_.is_playlist() && !parts.empty() && parts[0]->no_ranges) return UINT64_MAX;
  return static_cast<uint64_t>(kPathShare * static_cast<double>(blocks_.capacity_bytes()));
}

void Playback::choose_rungs() {
  uint32_t top = 0;
  for (Part* part : planner_.parts()) {
    set_limit(part);
    if (part->is_open()) top = std::max(top, part->limit);
  }
  settings_.top = top;
  if (!has_begun_ || quality_.fixed != 0 || reader_.read_at != nullptr) {
    settings_.floor = quality_.fixed != 0 && has_begun_ ? top : 0;
    settings_.target = settings_.fill = has_begun_ ? top : 0;
    choice_.cancel = RateCancel::kNone;
    choice_is_old_ = false;
    return;
  }
  settings_.floor = 0;
  const bool has_states = planner_.num_rungs() == rate_.num_rungs();
  if (has_states && now_ - chosen_at_ >= kChoiceSeconds) {
    chosen_at_ = now_;
    choice_is_old_ = false;
    std::vector<RungState> states(planner_.num_rungs());
    const double speed = std::max(clock_.speed(), 0.1);
    for (uint32_t r = 0; r < states.size(); ++r) {
      states[r] = {planner_.ready_distance(r) / speed, planner_.missing_bytes(r)};
    }
    rate_.choose(states.data(), &choice_);
  }
  settings_.target = std::min(choice_.rung, top);
  settings_.fill = std::min(std::max(choice_.fill_rung, choice_.rung), top);
}

void Playback::update_items(bool changed) {
  const bool loads = options_.loader == L4D_LOADER_CALLER;
  const auto update = [&](const Part& part, Item* item) {
    item->hidden = item->lacks;
    item->loaded = false;
    if (!loads || !item->is_bucket()) return;
    const Ladder& ladder = part.map.ladder();
    const uint32_t top = ladder.size() - 1;
    const bool full = !ladder.has_detail || part.rung_of(settings_.target) == top;
    const Residents::Bucket* const bucket = residents_.find({part.slot, item->layer, item->bucket});
    const bool is_loaded = bucket != nullptr && bucket->is_loaded;
    const bool is_full = is_loaded && (bucket->detail == L4D_DETAIL_FULL || item->num_detail == 0);
    item->hidden = is_full ? Item::kAllHere : is_loaded ? top : item->rung;
    item->loaded = is_full || (is_loaded && !full);
  };
  const bool moved =
      clock_.motion != L4D_MOTION_PLAYING && settings_.position.time != sorted_.position.time;
  const bool sorts = changed || sorts_ || moved || !settings_.same_order(sorted_);
  if (!sorts && !bytes_changed_) {
    planner_.find_states();
    return;
  }
  planner_.refresh(update, sorts);
  choice_is_old_ = true;
  if (sorts) sorted_ = settings_;
  sorts_ = bytes_changed_ = false;
}

void Playback::choose_shown() {
  const double speed = std::max(clock_.speed(), 0.0);
  const double floor_ready = planner_.ready_distance(settings_.floor);
  uint32_t shown = settings_.floor;
  for (uint32_t rung = settings_.target; rung > settings_.floor; --rung) {
    const double ready = planner_.ready_distance(rung);
    const double wanted = speed * (rung > shown_ ? kUpSeconds : kStaySeconds);
    if (!(ready > 0) || ready < std::min(wanted, floor_ready)) continue;
    shown = rung;
    break;
  }
  show_rung(shown);
  find_ready();
}

void Playback::serve_search() {
  while (current_.active) {
    const bool here = ready_interval(settings_.floor, clock_.position.time).ready;
    uint32_t cause = L4D_CAUSE_NONE;
    for (const Part* part : planner_.parts()) {
      if (here || settings_.tolerant || cause != L4D_CAUSE_NONE || part->segments[0].at > 0) break;
      cause = planner_.cause_at(*part, settings_.floor, part->segments[0].from);
    }
    if (!here && cause == L4D_CAUSE_NONE) return;
    end_search(&current_, here ? L4D_EVENT_SHOWN : L4D_EVENT_FAILED, cause);
    if (!next_.active) break;
    current_ = next_;
    next_.active = false;
    move_to(current_.time);
    return;  // update() plans for it
  }
  if (search_ == L4D_SEARCH_SEEKING) search_ = L4D_SEARCH_NONE;
}

void Playback::resume() {
  if (clock_.motion != L4D_MOTION_WAITING || search_ != L4D_SEARCH_NONE || !ready_.ready) return;
  const Position& at = clock_.position;
  // At an end that grows, what is there is not all that there is.
  const bool grows = path_.grows() && at.direction > 0;
  const double room = grows ? path_.end() - at.time : HUGE_VAL;
  const double ready = std::min(planner_.ready_distance(settings_.floor), room);
  double seconds = clock_.seconds_to_resume(options_.start_ahead);
  if (grows && live_.is_starved()) {
    seconds = std::max(seconds, std::min(live_.seconds_to_resume(now_), options_.ahead));
  }
  const double wanted = seconds * clock_.speed();
  const bool complete = planner_.wanted_bytes(settings_.floor) == 0 &&
                        residents_.num_loading() == 0 && room >= wanted;
  const double end = at.direction > 0 ? ready_.until : ready_.from;
  const bool moves = at.direction * (end - at.time) > 0 ||
                     at.direction * (end - path_.border(at)) >= 0 || clock_.speed() == 0;
  if (!moves || !(ready >= wanted || complete)) return;
  live_.set_fed();
  // What a wait has lost, the rate would make good in minutes. On a slow link, the jump needs bytes
  // again: it is the only one of this wait.
  if (rebuffers_ && follows_end() && live_.state(now_, at.time) == L4D_LIVE_BEHIND) {
    rebuffers_ = false;
    jump_to(clamped(HUGE_VAL));
    return;
  }
  clock_.set_anchor(now_);
  set_motion(L4D_MOTION_PLAYING);
}

void Playback::unload(const Residents::Bucket& bucket) {
  reserve_item();
  l4d_playback_item& out = add_item(L4D_ITEM_UNLOAD);
  out.stream = bucket.stream;
  out.layer = bucket.name.layer;
  out.bucket = bucket.name.bucket;
  out.detail = bucket.detail;
  residents_.remove(bucket.name);
}

// Unloads the bucket that was needed longest ago; false: all are needed.
bool Playback::unload_one() {
  const Residents::Bucket* const victim = residents_.victim();
  if (victim == nullptr) return false;
  unload(*victim);
  bytes_changed_ = sorts_ = true;
  return true;
}

// Returns whether the next bucket may be loaded, too.
bool Playback::add_load(const Part& part, const Item& item) {
  const Ladder& ladder = part.map.ladder();
  const uint32_t target = part.rung_of(settings_.target);
  if (item.lacks <= item.rung) return true;
  const bool full =
      item.lacks == Item::kAllHere && (!ladder.has_detail || target == ladder.size() - 1);
  const uint32_t detail =
      full || !ladder.has_detail || item.num_detail == 0 ? L4D_DETAIL_FULL : L4D_DETAIL_BASE_COLOR;
  // Base colours alone are of no use where detail is shown or nothing.
  if (detail != L4D_DETAIL_FULL && part.rung_of(settings_.floor) == ladder.size() - 1) return true;
  const BucketName name{part.slot, item.layer, item.bucket};
  const Residents::Bucket* const known = residents_.find(name);
  if (known != nullptr && known->load != 0) return true;
  if (known != nullptr && known->is_loaded &&
      (known->detail == detail || known->detail == L4D_DETAIL_FULL)) {
    return true;
  }
  while (known == nullptr && !residents_.fits(item.units)) {
    if (!unload_one()) return false;
  }
  reserve_item();
  residents_.begin_load(name, part.entry.number, last_load_ + 1, detail, item.units);
  l4d_playback_item& out = add_item(L4D_ITEM_LOAD);
  out.id = ++last_load_;
  out.stream = part.entry.number;
  out.layer = item.layer;
  out.bucket = item.bucket;
  out.detail = detail;
  out.units = item.units;
  out.needed_at = now_ + item.distance / std::max(clock_.speed(), 1e-3);
  return true;
}

// The buckets of the path in its order, and which layers lack the tables that they need.
void Playback::order_loads() {
  const std::vector<Part*>& parts = planner_.parts();
  load_order_.clear();
  lacks_tables_.assign(parts.size(), 0);
  for (uint32_t p = 0; p < parts.size(); ++p) {
    if (!parts[p]->is_open() || parts[p]->is_lost()) continue;
    const std::vector<Item>& items = parts[p]->map.items();
    for (uint32_t i = 0; i < items.size(); ++i) {
      const Item& item = items[i];
      if (item.is_bucket()) {
        const bool shows =
            item.distance < HUGE_VAL && item.rung <= parts[p]->rung_of(settings_.target);
        if (shows) load_order_.push_back({item.distance, item.rung, p, i});
      } else if (item.begin == -HUGE_VAL && item.lacks != Item::kAllHere) {
        lacks_tables_[p] |= item.layer == 0 ? UINT32_MAX : uint32_t{1} << item.layer;
      }
    }
  }
  std::sort(load_order_.begin(), load_order_.end(), [](const LoadOrder& a, const LoadOrder& b) {
    if (a.distance != b.distance) return a.distance < b.distance;
    if (a.rung != b.rung) return a.rung < b.rung;
    return a.part != b.part ? a.part < b.part : a.item < b.item;
  });
}

void Playback::add_loads() {
  if (options_.loader != L4D_LOADER_CALLER || !has_begun_) return;
  order_loads();
  const std::vector<Part*>& parts = planner_.parts();
  const auto item_of = [&](const LoadOrder& o) -> const Item& {
    return parts[o.part]->map.items()[o.item];
  };
  // What fits into the store of the caller, from the instant on, is needed.
  residents_.begin_epoch();
  uint64_t units = 0;
  size_t fitting = 0;
  for (; fitting < load_order_.size(); ++fitting) {
    const uint64_t more = residents_.rounded(item_of(load_order_[fitting]).units);
    if (more > residents_.max_units() - units) break;
    units += more;
  }
  for (size_t k = fitting; k > 0; --k) {
    const LoadOrder& o = load_order_[k - 1];
    residents_.use({parts[o.part]->slot, item_of(o).layer, item_of(o).bucket});
  }
  if (options_.max_units == UINT64_MAX) {
    while (has_room() && unload_one()) {
    }
  } else if (fitting < load_order_.size()) {
    const LoadOrder& o = load_order_[fitting];
    const Part& part = *parts[o.part];
    const bool needed = o.rung <= part.rung_of(settings_.floor) &&
                        item_of(o).is_visible(part.time_of(clock_.position.time));
    if (needed && stream_ != L4D_STREAM_FAILED) fail_stream(L4D_CAUSE_LIMIT, HUGE_VAL);
  }
  for (size_t k = 0; k < fitting; ++k) {
    const LoadOrder& o = load_order_[k];
    if (residents_.num_loading() >= options_.max_loads || !has_room()) break;
    if ((lacks_tables_[o.part] >> item_of(o).layer & 1) != 0) continue;
    if (!add_load(*parts[o.part], item_of(o))) break;
  }
}

void Playback::plan() {
  if (is_closed()) return;
  for (int round = 0; round < kMostRounds; ++round) {
    const bool serves = current_.active;
    const uint32_t id = current_.id;
    choose_rungs();
    settings_.position = clock_.position;
    settings_.rate = clock_.speed();
    settings_.levels = quality_.point.levels;
    settings_.network = quality_.network;
    settings_.instant_only = search_ == L4D_SEARCH_SCRUBBING;
    settings_.pool_bytes = bytes_for_path();
    const bool changed = follow();
    update_items(changed);
    if (reader_.read_at != nullptr) read_wanted();
    choose_shown();
    serve_search();
    if (!current_.active || (serves && current_.id == id)) break;
  }
  if (planner_.overflows() && stream_ != L4D_STREAM_FAILED) {
    fail_stream(L4D_CAUSE_LIMIT, HUGE_VAL);
  }
  update_live();
  if (planner_.is_cut() && !was_cut_) add_event(L4D_EVENT_LIMIT, 0, L4D_CAUSE_LIMIT, 0);
  was_cut_ = planner_.is_cut();
  add_loads();
  if (bytes_changed_) {
    // What was unloaded is not ready any more.
    update_items(false);
    find_ready();
  }
  // With other settings, what has played may not be ready any more.
  if (clock_.motion == L4D_MOTION_PLAYING && !ready_.ready) lower_rung_or_wait();
  resume();
}

void Playback::update(double now) {
  advance(now);
  if (is_closed()) {
    wake_at_ = HUGE_VAL;
    return;
  }
  expire();
  plan();
  cancel_unwanted();
  add_requests();
  find_wake_at();
}

void Playback::find_wake_at() {
  double next = std::min({link_.next_deadline(), waits_until_, live_.next_time(now_)});
  for (const auto& part : presentation_.parts()) {
    next = std::min(next, part->ledger.next_time(now_));
    if (part->is_lost()) next = std::min(next, part->retry_at);
  }
  const bool may_look = presentation_.is_playlist() && list_request_ == 0 && link_.has_slot() &&
                        stream_ != L4D_STREAM_FAILED && quality_.network != L4D_NETWORK_NONE;
  if (may_look) {
    next = std::min(next, std::max(list_at_, link_.hold_until()));
  }
  if (stream_ == L4D_STREAM_FAILED) next = std::min(next, retry_at_);
  if (clock_.motion == L4D_MOTION_PLAYING && clock_.speed() > 0) {
    const Position& at = clock_.position;
    const double border = path_.border(at);
    double stop = at.direction > 0 ? std::min(ready_.until, border) : std::max(ready_.from, border);
    // At the next cell, the path has another end.
    const double origin = presentation_.media(presentation_.media_at(at.time)).begin;
    const double cells = (at.time - origin) / Planner::kCellSeconds;
    const double cell = at.direction > 0 ? std::floor(cells) + 1 : std::ceil(cells) - 1;
    const double turn = origin + cell * Planner::kCellSeconds;
    stop = at.direction > 0 ? std::min(stop, turn) : std::max(stop, turn);
    next = std::min(next, clock_.when(stop));
    if (!link_.requests().empty()) next = std::min(next, now_ + kChoiceSeconds);
  }
  // Also where nothing is under way: with what has come, another rung may be wanted. While the
  // path has other rungs than the choice is of, as before a member is open, there is none.
  const bool may_rise = has_begun_ && planner_.num_rungs() == rate_.num_rungs() &&
                        choice_.rung + 1 < rate_.num_rungs();
  if (choice_is_old_ && may_rise && quality_.fixed == 0 && reader_.read_at == nullptr) {
    next = std::min(next, chosen_at_ + kChoiceSeconds);
  }
  // What did not fit into the queue waits for the caller to take some of it.
  if (!has_room() || sorts_ || bytes_changed_) next = now_;
  wake_at_ = std::max(next, now_ + kLeastStep);
}

}  // namespace l4d::playback
