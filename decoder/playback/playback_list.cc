// SPDX-License-Identifier: Apache-2.0
// How Playback follows a playlist, and the end of one that grows.
#include <algorithm>
#include <cmath>
#include <utility>

#include "decoder/playback/playback.h"

namespace l4d::playback {
namespace {

constexpr double kFailedDelay = 10;
constexpr uint32_t kMostErrors = 2;    // of a playlist that was never read, in a row
constexpr double kOlderDurations = 3;  // after which an older playlist is another one

}  // namespace

void Playback::add_list_request() {
  if (!presentation_.is_playlist() || list_request_ != 0 || list_at_ > now_) return;
  if (!has_room() || !link_.has_slot() || link_.hold_until() > now_ ||
      quality_.network == L4D_NETWORK_NONE)
    return;
  list_text_.clear();
  list_bytes_ = 0;
  WantedRange range;
  range.end = UINT64_MAX;
  range.urgency = Urgency::kTables;
  add_request(range);
  list_request_ = link_.requests().back().id;
}

void Playback::receive_list(ByteSpan data) {
  Request* const request = link_.find(list_request_);
  if (list_text_.size() + data.size() > kMaxPlaylistBytes) {
    cancel(list_request_);
    fail_list(L4D_CAUSE_LIMIT, 0);
    return;
  }
  list_text_.insert(list_text_.end(), data.begin(), data.end());
  request->useful += data.size();
}

// The link may have spoilt it: it is looked at once more before that counts.
void Playback::fail_list(uint32_t cause, uint32_t line) {
  ++list_errors_;
  if (has_begun_ || list_errors_ < kMostErrors) {
    live_.add_failed_look(now_);
    list_at_ = live_.look_at();
    return;
  }
  list_at_ = now_;
  fail_stream(cause, now_ + kFailedDelay * list_errors_);
  queue_.back().offset = line;
}

void Playback::finish_list() {
  list_request_ = 0;
  Playlist list;
  const PlaylistError error =
      parse_playlist(reinterpret_cast<const char*>(list_text_.data()), list_text_.size(), &list);
  // Half a line may look like a whole one.
  const bool is_cut = list_text_.empty() || (list_text_.back() != '\n' && !list.is_complete);
  list_text_ = Bytes();
  const bool has_media = std::any_of(list.members.begin(), list.members.end(),
                                     [](const Member& m) { return m.is_media; });
  if (is_cut) {
    fail_list(L4D_CAUSE_TRUNCATED, 0);
  } else if (error.cause != L4D_CAUSE_NONE) {
    fail_list(error.cause, error.line);
  } else if (list.is_complete && !has_media) {
    fail_list(L4D_CAUSE_PLAYLIST, 0);
  } else {
    list_errors_ = 0;
    take_list(std::move(list));
  }
}

void Playback::take_list(Playlist&& list) {
  const PlaylistChange change =
      has_list_ ? compare(presentation_.list(), list) : PlaylistChange::kGrown;
  if (change == PlaylistChange::kOlder && older_since_ < 0) older_since_ = now_;
  if (change != PlaylistChange::kOlder) older_since_ = -1;
  const bool gone =
      change == PlaylistChange::kOther ||
      (older_since_ >= 0 && now_ - older_since_ >= kOlderDurations * live_.target_duration());
  if (gone) {
    restart(std::move(list));
  } else if (change == PlaylistChange::kOlder) {
    live_.add_failed_look(now_);
    list_at_ = live_.look_at();
  } else {
    set_list(std::move(list), change == PlaylistChange::kGrown);
  }
}

void Playback::set_list(Playlist&& list, bool grown) {
  const double begin = presentation_.begin(), end = presentation_.end();
  const bool complete = list.is_complete;
  const double target = list.target_duration;
  has_list_ = true;
  if (grown) presentation_.set_list(std::move(list), clock_.position.time);
  live_.add_look(now_, presentation_.end(), target, complete, grown);
  list_at_ = live_.look_at();
  if (!grown) return;
  sorts_ = true;
  // A playlist may be ahead of its files.
  for (const auto& part : presentation_.parts()) {
    if (part->lost == L4D_CAUSE_NOT_FOUND || part->lost == L4D_CAUSE_TRUNCATED) {
      seek_part_again(part.get());
    }
  }
  if (!presentation_.has_media()) return;
  if (!has_begun_) {
    begin_playback();
  } else {
    set_path_range();
  }
  if (presentation_.begin() != begin || presentation_.end() != end) {
    add_event(L4D_EVENT_GROWN, 0, L4D_CAUSE_NONE, presentation_.end());
  }
}

// Another recording at the same place: nothing of the one before can be had.
void Playback::restart(Playlist&& list) {
  if (options_.refuse_restart != 0) {
    fail_stream(L4D_CAUSE_CHANGED, HUGE_VAL);
    return;
  }
  end_searches(L4D_EVENT_FAILED, L4D_CAUSE_CHANGED);
  search_ = L4D_SEARCH_NONE;
  planner_.forget_parts();
  while (!presentation_.parts().empty()) close_part(presentation_.parts().back().get());
  presentation_.open_playlist();
  blocks_.clear();
  live_.close();
  ready_ = {};
  has_begun_ = has_position_ = false;
  passed_over_ = 0;
  older_since_ = -1;
  set_stream(L4D_STREAM_OPENING, L4D_CAUSE_NONE);
  set_list(std::move(list), true);
  live_.set_restarted();
  if (wants_play_) {
    clock_.wait_for_start();
    set_motion(L4D_MOTION_WAITING);
  } else {
    set_motion(L4D_MOTION_PAUSED);
  }
}

// Whether the rate is one at which the end stays as far away as it is.
bool Playback::follows_end() const {
  return follows_ && path_.grows() && clock_.rate == 1 && clock_.position.direction > 0;
}

void Playback::jump_to(double time) {
  const double from = clock_.position.time;
  move_to(time);
  add_event(L4D_EVENT_JUMPED, 0, L4D_CAUSE_NONE, time - from);
}

// Of a time before the begin of the playlist: what was shown there cannot be had any more.
bool Playback::is_gone(double time) const {
  const Part* const part =
      presentation_.find(presentation_.media(presentation_.media_at(time)).number);
  return !ready_.ready || (part != nullptr && part->is_lost());
}

// Before playback goes on, after what is ready is known.
void Playback::update_live() {
  if (!presentation_.is_playlist() || !has_begun_) return;
  if (ready_.ready) live_.set_shown();
  const double time = clock_.position.time;
  const bool plays = clock_.motion == L4D_MOTION_PLAYING || clock_.motion == L4D_MOTION_WAITING;
  if (plays && !current_.active) {
    const bool late = live_.delay(now_, time) > live_.max_distance(now_);
    if (follows_end() && late) {
      jump_to(clamped(HUGE_VAL));
    } else if (time < path_.begin() && !has_range_ && is_gone(time)) {
      jump_to(follows_end() ? clamped(HUGE_VAL) : path_.begin());
    }
  }
  const double factor = follows_end() ? live_.factor(now_, clock_.position.time) : 1;
  if (factor != clock_.factor) {
    clock_.factor = factor;
    sorts_ = true;
  }
  const uint32_t state = live_.state(now_, clock_.position.time);
  if (state == live_state_) return;
  live_state_ = state;
  add_event(L4D_EVENT_LIVE, 0, L4D_CAUSE_NONE, state);
}

}  // namespace l4d::playback
