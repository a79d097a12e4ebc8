// SPDX-License-Identifier: Apache-2.0
// What Playback makes of answers and failures.
#include <algorithm>
#include <cmath>

#include "decoder/playback/playback.h"

namespace l4d::playback {
namespace {}  // namespace

void Playback::fail_stream(uint32_t cause, double retry_at) {
  if (stream_ == L4D_STREAM_FAILED && cause_ == cause && retry_at_ == retry_at) return;
  cancel_all(nullptr);
  retry_at_ = retry_at;
  set_stream(L4D_STREAM_FAILED, cause);
  end_searches(L4D_EVENT_FAILED, cause);
  if (search_ == L4D_SEARCH_SEEKING) search_ = L4D_SEARCH_NONE;
}

// Leaves FAILED. Of another version of the file nothing is kept.
void Playback::try_again() {
  const bool other = cause_ == L4D_CAUSE_CHANGED;
  if (other) {
    planner_.forget_parts();
    while (!presentation_.parts().empty()) close_part(presentation_.parts().back().get());
    blocks_.clear();
    blocks_.set_limit(options_.byte_pool_bytes);
    rate_ = RateControl(rate_.options(), 1);
    choice_ = {};
    ready_ = {};
    shown_ = 0;
    if (clock_.motion == L4D_MOTION_PLAYING) {
      clock_.wait_for_start();
      set_motion(L4D_MOTION_WAITING);
    }
    has_position_ = true;
    has_begun_ = has_list_ = false;
    if (presentation_.is_playlist()) {
      presentation_.open_playlist();
      live_.close();
    } else {
      presentation_.open_stream(UINT64_MAX);
    }
  }
  passed_over_ = list_errors_ = 0;
  older_since_ = -1;
  if (presentation_.is_playlist() && (other || !has_begun_)) list_at_ = now_;
  for (const auto& part : presentation_.parts()) {
    const Ledger::Entry* const lost = part->map.lost_header();
    if (lost != nullptr) part->ledger.retry(lost->offset, now_);
  }
  link_.retry();
  expect_more();
  sorts_ = true;
  wake_at_ = now_;
  const bool opens = !has_begun_ || presentation_.is_playlist();
  set_stream(opens ? L4D_STREAM_OPENING : L4D_STREAM_OPEN, L4D_CAUSE_NONE);
}

void Playback::cancel(uint32_t id) {
  add_item(L4D_ITEM_CANCEL).id = id;
  if (id == list_request_) list_request_ = 0;
  link_.remove(id);
}

// part: null: of all.
void Playback::cancel_all(const Part* part) {
  for (size_t i = link_.requests().size(); i > 0; --i) {
    const Request& request = link_.requests()[i - 1];
    if (part == nullptr || request.part == part) cancel(request.id);
  }
}

void Playback::fail_request(uint32_t id, uint32_t cause, double retry_after, bool cancels) {
  Part* const part = link_.find(id)->part;
  if (cancels) {
    cancel(id);
  } else {
    if (id == list_request_) list_request_ = 0;
    link_.remove(id);
  }
  bool went_down = false;
  const double delay = link_.add_failure(id, now_, retry_after, &went_down);
  add_event(L4D_EVENT_RETRY, id, cause, delay);
  wake_at_ = now_;
  if (went_down) add_event(L4D_EVENT_SOURCE_DOWN, 0, cause, 0);
  if (link_.is_down() && stream_ == L4D_STREAM_OPENING) {
    fail_stream(cause, link_.hold_until());
  } else if (went_down && stream_ == L4D_STREAM_OPEN) {
    set_stream(L4D_STREAM_DEGRADED, cause);
  }
  if (part == nullptr || !presentation_.is_playlist()) return;
  // If others answer meanwhile, it is not the link.
  if (part->failures++ == 0) part->failed_at = now_;
  const bool alone = link_.succeeded_at() > part->failed_at;
  if (part->failures >= options_.failures && alone) lose_part(part, cause, -1);
}

// A file that is not there, or is empty, may come: it is looked for less and less often.
void Playback::fail_for_now(uint32_t id, uint32_t cause) {
  Part* const part = link_.find(id)->part;
  if (id == list_request_) list_request_ = 0;
  link_.remove(id);
  if (part != nullptr && presentation_.is_playlist()) {
    lose_part(part, cause, -1);
    return;
  }
  if (part == nullptr && has_begun_) {
    live_.add_failed_look(now_);
    list_at_ = live_.look_at();
    return;
  }
  const double delay = lost_delay(not_found_);
  if (not_found_ < 10) ++not_found_;
  list_at_ = now_;
  fail_stream(cause, now_ + delay);
}

// Of a file of which a member is a part, only its end can be known.
bool Playback::check_version(Part* part, const l4d_answer& answer) {
  if (part->entry.bytes > 0) return true;
  const uint64_t size = part->map.file_size();
  const bool other_version =
      answer.version != 0 && part->version != 0 && answer.version != part->version;
  const bool other_size =
      answer.total_bytes != 0 && size != UINT64_MAX && answer.total_bytes != size;
  if (other_version || other_size) return false;
  if (answer.version != 0) part->version = answer.version;
  if (answer.total_bytes != 0 && size == UINT64_MAX) part->map.set_file_size(answer.total_bytes);
  return true;
}

// The server has no ranges: one request has all.
void Playback::take_whole_file(Request* request) {
  Part* const part = request->part;
  const uint32_t id = request->id;
  for (size_t i = link_.requests().size(); i > 0; --i) {
    const Request& other = link_.requests()[i - 1];
    if (other.id != id && other.part == part) cancel(other.id);
  }
  part->no_ranges = true;
  blocks_.set_limit(std::max(options_.max_memory_bytes, options_.byte_pool_bytes));
  sorts_ = true;
  Request* const whole = link_.find(id);
  whole->whole = true;
  whole->at = 0;
  whole->end = UINT64_MAX;
}

void Playback::answered_list(Request* request, const l4d_answer& answer) {
  const uint32_t id = request->id, status = answer.status;
  if (status == 200 || (status == 206 && answer.offset == 0)) {
    list_bytes_ = answer.total_bytes;
  } else if (status == 404 || status == 410 || status == 416) {
    fail_for_now(id, L4D_CAUSE_NOT_FOUND);
  } else if (status >= 400 && status < 500 && status != 408 && status != 429) {
    list_request_ = 0;
    link_.remove(id);
    fail_stream(L4D_CAUSE_FORBIDDEN, HUGE_VAL);
  } else {
    fail_request(id, L4D_CAUSE_NETWORK, answer.retry_after, false);
  }
}

void Playback::answered(double now, uint32_t id, const l4d_answer& answer) {
  advance(now);
  Request* const request = link_.find(id);
  if (request == nullptr || request->answered) return;
  wake_at_ = now_;
  request->answered = true;
  request->first_byte = request->last_byte = now_;
  if (request->part == nullptr) {
    answered_list(request, answer);
    return;
  }
  Part* const part = request->part;
  const uint32_t status = answer.status;
  const bool has_file = status == 200 || status == 206 || status == 416;
  const bool known = part->map.file_size() != UINT64_MAX;
  if (has_file && !check_version(part, answer)) {
    if (presentation_.is_playlist()) cancel_all(part);
    fail_source(part, L4D_CAUSE_CHANGED, presentation_.is_playlist() ? -1 : HUGE_VAL);
    return;
  }
  if (status == 200 && part->entry.bytes > 0) {
    cancel(id);
    fail_source(part, L4D_CAUSE_NO_RANGES, HUGE_VAL);
  } else if (status == 200) {
    take_whole_file(request);
  } else if (status == 206) {
    if (answer.offset != part->entry.offset + request->at || request->whole) {
      fail_request(id, L4D_CAUSE_NETWORK, 0, true);  // another range than the one that was wanted
    }
  } else if (status == 404 || status == 410) {
    fail_for_now(id, L4D_CAUSE_NOT_FOUND);
  } else if (status == 416 && (part->entry.bytes > 0 || (request->at == 0 && !part->is_open()))) {
    fail_for_now(id, L4D_CAUSE_TRUNCATED);  // not even a first byte
  } else if (status == 416) {
    if (!known) guess_size(part, request->at);
    link_.remove(id);
    if (known && !part->guesses_size) {
      fail_source(part, L4D_CAUSE_CHANGED, presentation_.is_playlist() ? -1 : HUGE_VAL);
    }
  } else if (status >= 400 && status < 500 && status != 408 && status != 429) {
    link_.remove(id);
    fail_source(part, L4D_CAUSE_FORBIDDEN, HUGE_VAL);
  } else {
    fail_request(id, L4D_CAUSE_NETWORK, answer.retry_after, false);
  }
}

void Playback::finished(double now, uint32_t id, uint32_t outcome) {
  advance(now);
  Request* const request = link_.find(id);
  if (request == nullptr) return;
  wake_at_ = now_;
  Part* const part = request->part;
  if (outcome == L4D_TRANSFER_FORBIDDEN) {
    link_.remove(id);
    if (part != nullptr) {
      fail_source(part, L4D_CAUSE_FORBIDDEN, HUGE_VAL);
    } else {
      list_request_ = 0;
      fail_stream(L4D_CAUSE_FORBIDDEN, HUGE_VAL);
    }
    return;
  }
  if (request->received > 0) {
    rate_.add(request->sent, request->first_byte, request->last_byte, request->received);
  }
  const bool is_cut = part == nullptr && list_bytes_ != 0 && list_text_.size() < list_bytes_;
  if (outcome != L4D_TRANSFER_ENDED || request->useful == 0 || is_cut) {
    const bool is_empty = outcome == L4D_TRANSFER_ENDED && request->answered &&
                          request->received == 0 && request->at == 0;
    fail_request(id, is_empty ? L4D_CAUSE_TRUNCATED : L4D_CAUSE_NETWORK, 0, false);
    return;
  }
  // Of a file whose size nobody has stated, the end says it.
  if (part != nullptr && request->whole && part->map.file_size() == UINT64_MAX) {
    guess_size(part, request->at);
  }
  link_.remove(id);
  not_found_ = 0;
  if (part != nullptr) part->failures = 0;
  if (link_.add_success(now_)) {
    add_event(L4D_EVENT_SOURCE_UP, 0, L4D_CAUSE_NONE, 0);
    if (stream_ == L4D_STREAM_DEGRADED) set_stream(L4D_STREAM_OPEN, L4D_CAUSE_NONE);
  }
  if (part == nullptr) finish_list();
}

void Playback::guess_size(Part* part, uint64_t bytes) {
  part->map.set_file_size(bytes);
  part->guesses_size = true;
}

// What was lost is wanted again: also what lies behind the end of a file, if that was a guess, as
// answers that are cut look like it.
void Playback::expect_more() {
  bytes_changed_ = true;
  for (const auto& part : presentation_.parts()) {
    part->map.set_stale();
    if (part->guesses_size) part->map.set_file_size(UINT64_MAX);
    part->guesses_size = false;
  }
}

void Playback::expire() {
  for (size_t i = link_.requests().size(); i > 0; i = std::min(i - 1, link_.requests().size())) {
    const Request& request = link_.requests()[i - 1];
    if (link_.deadline_of(request) > now_) continue;
    fail_request(request.id, L4D_CAUSE_TIMEOUT, 0, true);
  }
  for (const auto& part : presentation_.parts()) {
    if (part->ledger.expire(now_)) expect_more();
    if (part->is_lost() && part->retry_at <= now_) seek_part_again(part.get());
  }
  if (stream_ == L4D_STREAM_FAILED && retry_at_ <= now_) try_again();
}

}  // namespace l4d::playback
