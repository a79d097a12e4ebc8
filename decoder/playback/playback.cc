// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/playback.h"

#include <algorithm>
#include <cmath>

namespace l4d::playback {
namespace {

constexpr uint64_t kDefaultMemory = uint64_t{1} << 30;
constexpr uint64_t kDefaultPool = uint64_t{256} << 20;
// Borders of a short loop that one step of `now` may pass.
constexpr int kMostTurns = 64;

template <typename T>
void replace_zero(T* value, T by) {
  if (*value == 0) *value = by;
}

LinkOptions link_options(const l4d_playback_options& o) {
  LinkOptions out;
  out.failures = o.failures;
  out.max_requests = o.max_requests;
  out.first_byte_timeout = o.first_byte_timeout;
  out.urgent_timeout = o.urgent_timeout;
  out.idle_timeout = o.idle_timeout;
  out.retry_delay = o.retry_delay;
  out.max_retry_delay = o.max_retry_delay;
  return out;
}

RateOptions rate_options(const l4d_playback_options& o) {
  RateOptions out{};
  out.ahead = o.ahead;
  out.up_buffer = o.ahead * 2 / 3;
  return out;
}

}  // namespace

Status resolve(l4d_playback_options* o) {
  replace_zero(&o->max_memory_bytes, kDefaultMemory);
  replace_zero(&o->byte_pool_bytes, kDefaultPool);
  replace_zero(&o->max_units, UINT64_MAX);
  replace_zero(&o->unit_grain, 1u);
  replace_zero(&o->failures, 5u);
  replace_zero(&o->max_requests, 6u);
  replace_zero(&o->max_loads, 2u);
  replace_zero(&o->threads, 1u);
  const struct {
    double* value;
    double by;
  } numbers[] = {{&o->ahead, 6},           {&o->start_ahead, 0.5}, {&o->first_byte_timeout, 10},
                 {&o->urgent_timeout, 3},  {&o->idle_timeout, 5},  {&o->retry_delay, 0.25},
                 {&o->max_retry_delay, 8}, {&o->max_step, 1}};
  for (const auto& n : numbers) {
    replace_zero(n.value, n.by);
    if (!(*n.value > 0) || !std::isfinite(*n.value)) {
      return invalid_argument("times are finite, and 0 or more");
    }
  }
  if (o->loader > L4D_LOADER_CALLER) return invalid_argument("unknown loader");
  if (o->max_requests > 64) return invalid_argument("max_requests is 64 at most");
  if (o->ahead > 600 || o->start_ahead > o->ahead) {
    return invalid_argument("ahead is 600 at most, and start_ahead no more than ahead");
  }
  replace_zero(&o->live_slow, 0.95);
  replace_zero(&o->live_fast, 1.05);
  for (const double seconds : {o->live_distance, o->max_live_distance, o->stale_after}) {
    if (!(seconds >= 0 && std::isfinite(seconds))) {
      return invalid_argument("times are finite, and 0 or more");
    }
  }
  if (!(o->live_slow >= 0.5 && o->live_slow <= 1 && o->live_fast >= 1 && o->live_fast <= 2)) {
    return invalid_argument("live_slow is from 0.5 to 1, and live_fast from 1 to 2");
  }
  return {};
}

Playback::Playback(const l4d_playback_options& options, Decoders& decoders)
    : options_(options),
      blocks_(options.byte_pool_bytes),
      presentation_(blocks_, decoders),
      planner_(blocks_),
      link_(link_options(options)),
      live_(options),
      rate_(rate_options(options), 1) {
  residents_.set_limits(options.max_units, options.unit_grain);
  settings_.tolerant = options.strict == 0;
  settings_.ahead = options.ahead;
  settings_.start_ahead = options.start_ahead;
  wake_at_ = HUGE_VAL;
}

l4d_playback_item& Playback::add_item(uint32_t kind) {
  queue_.push_back({});
  queue_.back().kind = kind;
  return queue_.back();
}

void Playback::add_event(uint32_t event, uint32_t id, uint32_t cause, double value) {
  l4d_playback_item& item = add_item(L4D_ITEM_EVENT);
  item.id = id;
  item.event = event;
  item.cause = cause;
  item.time = clock_.position.time;
  item.value = value;
}

void Playback::add_chunk_events() {
  bytes_changed_ = bytes_changed_ || !chunk_events_.empty();
  for (const ChunkEvent& e : chunk_events_) {
    add_event(e.event, 0, e.cause, 0);
    queue_.back().stream = e.stream;
    queue_.back().offset = e.offset;
    queue_.back().size = e.size;
  }
  chunk_events_.clear();
}

void Playback::set_motion(uint32_t motion) {
  if (clock_.motion == motion) return;
  clock_.motion = motion;
  rebuffers_ = false;
  add_event(L4D_EVENT_MOTION, 0, L4D_CAUSE_NONE, motion);
}

void Playback::set_stream(uint32_t stream, uint32_t cause) {
  const bool same = stream_ == stream && cause_ == cause;
  stream_ = stream;
  cause_ = cause;
  if (!same) add_event(L4D_EVENT_STREAM, 0, cause, stream);
}

void Playback::show_rung(uint32_t rung) {
  if (shown_ == rung) return;
  shown_ = rung;
  add_event(L4D_EVENT_RUNG, 0, L4D_CAUSE_NONE, rung);
}

// At the end of what the shown rung has: a lower one may go on.
void Playback::lower_rung_or_wait() {
  const Position& at = clock_.position;
  for (uint32_t rung = shown_; rung > settings_.floor; --rung) {
    const ReadyInterval lower = ready_interval(rung - 1, at.time);
    const double end = at.direction > 0 ? lower.until : lower.from;
    if (!lower.ready || !(at.direction * (end - at.time) > 0)) continue;
    show_rung(rung - 1);
    find_ready();
    return;
  }
  if (path_.grows() && at.direction > 0 && at.time >= path_.end()) live_.add_starvation(now_);
  clock_.wait();
  rebuffers_ = true;
  add_event(L4D_EVENT_MOTION, 0, L4D_CAUSE_NONE, L4D_MOTION_WAITING);
}

// Brings the clock to `now`, by what was ready before this call.
void Playback::advance(double now) {
  now = std::max(now, now_);
  if (now - now_ > options_.max_step && clock_.motion == L4D_MOTION_PLAYING) {
    add_event(L4D_EVENT_LATE, 0, L4D_CAUSE_NONE, now - now_);
  }
  now_ = now;
  for (int turns = 0; turns < kMostTurns;) {
    const Position& at = clock_.position;
    const double ready = !ready_.ready ? at.time : at.direction > 0 ? ready_.until : ready_.from;
    const Clock::Stop stop = clock_.step(now, ready, path_.border(at));
    if (stop == Clock::Stop::kNow) return;
    if (stop == Clock::Stop::kUnready) {
      lower_rung_or_wait();
      continue;
    }
    ++turns;
    if (!path_.turn(&clock_.position)) {
      set_motion(L4D_MOTION_ENDED);
      continue;
    }
    add_event(L4D_EVENT_WRAPPED, 0, L4D_CAUSE_NONE, 0);
    find_ready();
  }
  clock_.set_anchor(now);
}

Status Playback::check_open() const {
  if (!is_closed()) return {};
  return Status(L4D_ERR_INVALID_STATE, "no stream is open");
}

void Playback::reset(double now, const char* uri) {
  close(now);
  uri_ = uri;
  const double rate = clock_.rate;
  clock_ = Clock();
  clock_.set_rate(rate);
  clock_.set_anchor(now_);
  path_.set_range(0, 0, L4D_PLAY_ONCE);
  set_stream(L4D_STREAM_OPENING, L4D_CAUSE_NONE);
  bytes_changed_ = sorts_ = true;
  wake_at_ = now_;
}

void Playback::open(double now, const char* uri, uint32_t kind, uint64_t size) {
  reset(now, uri);
  if (kind == L4D_OPEN_PLAYLIST) {
    presentation_.open_playlist();
    list_at_ = now_;
  } else {
    presentation_.open_stream(size > 0 ? size : UINT64_MAX);
  }
}

Status Playback::open_reader(double now, const l4d_reader& reader) {
  if (reader.read_at == nullptr || reader.size == nullptr) {
    return invalid_argument("the reader lacks a callback");
  }
  const int64_t size = reader.size(reader.user);
  if (size < 0) return Status(L4D_ERR_IO, "the reader cannot tell its size");
  reset(now, "");
  presentation_.open_stream(static_cast<uint64_t>(size));
  reader_ = reader;
  return {};
}

void Playback::close(double now) {
  advance(now);
  if (is_closed()) return;
  cancel_all(nullptr);
  end_searches(L4D_EVENT_REPLACED, L4D_CAUSE_NONE);
  planner_.forget_parts();
  presentation_.close();
  link_.open();
  live_.close();
  blocks_.clear();
  blocks_.set_limit(options_.byte_pool_bytes);
  residents_.clear();
  rate_ = RateControl(rate_options(options_), 1);
  choice_ = {};
  reader_ = {};
  uri_.clear();
  ready_ = {};
  has_list_ = has_begun_ = has_position_ = wants_play_ = was_cut_ = false;
  shown_ = not_found_ = 0;
  search_ = L4D_SEARCH_NONE;
  received_bytes_ = wasted_bytes_ = 0;
  settings_.floor = settings_.target = settings_.fill = 0;
  list_text_ = Bytes();
  list_request_ = list_errors_ = passed_over_ = 0;
  older_since_ = -1;
  follows_ = true;
  live_state_ = L4D_LIVE_NONE;
  set_motion(L4D_MOTION_PAUSED);
  set_stream(L4D_STREAM_CLOSED, L4D_CAUSE_NONE);
  wake_at_ = HUGE_VAL;
}

Status Playback::play(double now) {
  advance(now);
  L4D_RETURN_IF_ERROR(check_open());
  if (search_ == L4D_SEARCH_SCRUBBING && !current_.active) search_ = L4D_SEARCH_NONE;
  wants_play_ = true;
  wake_at_ = now_;
  if (clock_.motion == L4D_MOTION_PLAYING || clock_.motion == L4D_MOTION_WAITING) return {};
  if (clock_.motion == L4D_MOTION_ENDED) {
    move_to(clock_.position.direction > 0 ? path_.begin() : path_.end());
  }
  // Who has paused for long wants to see what comes then.
  follows_ = follows_ && live_.delay(now_, clock_.position.time) <= live_.max_distance(now_);
  clock_.wait_for_start();
  set_motion(L4D_MOTION_WAITING);
  return {};
}

Status Playback::pause(double now) {
  advance(now);
  L4D_RETURN_IF_ERROR(check_open());
  wants_play_ = false;
  if (clock_.motion != L4D_MOTION_ENDED) set_motion(L4D_MOTION_PAUSED);
  wake_at_ = now_;
  return {};
}

double Playback::clamped(double time) const {
  if (time == HUGE_VAL && path_.grows()) time = live_.live_time(now_);
  return std::clamp(time, path_.begin(), path_.end());
}

// Playback goes on from there when enough of it is here.
void Playback::move_to(double time) {
  if (time < HUGE_VAL) clock_.position.time = time;
  clock_.set_anchor(now_);
  find_ready();
  sorts_ = true;
  wake_at_ = now_;
  if (!wants_play_) {
    set_motion(L4D_MOTION_PAUSED);
    return;
  }
  clock_.wait_for_start();
  set_motion(L4D_MOTION_WAITING);
}

void Playback::end_search(Search* search, uint32_t event, uint32_t cause) {
  if (search->active) add_event(event, search->id, cause, 0);
  search->active = false;
}

void Playback::end_searches(uint32_t event, uint32_t cause) {
  end_search(&current_, event, cause);
  end_search(&next_, event, cause);
}

Status Playback::seek(double now, double time, double tolerance, uint32_t id) {
  advance(now);
  L4D_RETURN_IF_ERROR(check_open());
  if (stream_ == L4D_STREAM_FAILED) try_again();
  for (const auto& part : presentation_.parts()) {
    if (part->lost == L4D_CAUSE_NOT_FOUND) seek_part_again(part.get());
  }
  wake_at_ = now_;
  const Search search{true, id, has_begun_ ? clamped(time) : time};
  follows_ = !has_begun_ || live_.delay(now_, search.time) <= live_.max_distance(now_);
  if (tolerance > 0) {
    search_ = L4D_SEARCH_SCRUBBING;
    ReadyInterval near;
    if (has_begun_) near = ready_interval(settings_.floor, clock_.position.time);
    const double shown = std::clamp(search.time, near.from, near.until);
    if (!near.ready || std::fabs(shown - search.time) > tolerance) {
      Search* const place = current_.active ? &next_ : &current_;
      end_search(place, L4D_EVENT_REPLACED, L4D_CAUSE_NONE);
      *place = search;
      if (place == &current_) move_to(search.time);
      has_position_ = true;
      return {};
    }
    end_searches(L4D_EVENT_REPLACED, L4D_CAUSE_NONE);
    move_to(shown);
    add_event(L4D_EVENT_SHOWN, id, L4D_CAUSE_NONE, 0);
    return {};
  }
  end_searches(L4D_EVENT_REPLACED, L4D_CAUSE_NONE);
  current_ = search;
  search_ = L4D_SEARCH_SEEKING;
  has_position_ = true;
  move_to(search.time);
  return {};
}

void Playback::set_rate(double now, double rate) {
  advance(now);
  clock_.set_rate(rate);
  sorts_ = true;
  wake_at_ = is_closed() ? HUGE_VAL : now_;
}

void Playback::set_path_range() {
  const double begin = presentation_.begin(), end = presentation_.end();
  const double to = has_range_ ? std::clamp(range_end_, begin, end) : end;
  const bool grows = live_.grows() && !(has_range_ && range_end_ < end);
  path_.set_range(has_range_ ? std::clamp(range_begin_, begin, end) : begin, to, mode_, grows);
}

void Playback::set_range(double now, uint32_t mode, double begin, double end) {
  advance(now);
  mode_ = mode;
  has_range_ = begin <= end;
  range_begin_ = begin;
  range_end_ = end;
  if (is_closed()) return;
  wake_at_ = now_;
  if (!has_begun_) return;
  set_path_range();
  if (clamped(clock_.position.time) != clock_.position.time) {
    move_to(clamped(clock_.position.time));
  }
  current_.time = clamped(current_.time);
  next_.time = clamped(next_.time);
  if (clock_.motion == L4D_MOTION_ENDED && wants_play_) {
    clock_.wait_for_start();
    set_motion(L4D_MOTION_WAITING);
  }
  sorts_ = true;
}

void Playback::set_quality(double now, const l4d_quality& quality) {
  advance(now);
  quality_ = quality;
  bytes_changed_ = sorts_ = true;
  if (is_closed()) return;
  wake_at_ = now_;
  if (stream_ == L4D_STREAM_FAILED && cause_ == L4D_CAUSE_LIMIT) try_again();
}

void Playback::retry(double now) {
  advance(now);
  for (const auto& part : presentation_.parts()) {
    part->ledger.retry(now_);
    seek_part_again(part.get());
  }
  link_.retry();
  not_found_ = 0;
  if (is_closed()) return;
  expect_more();
  if (stream_ == L4D_STREAM_FAILED) try_again();
  wake_at_ = now_;
}

void Playback::refresh(double now) {
  advance(now);
  residents_.clear();
  bytes_changed_ = sorts_ = true;
  if (!is_closed()) wake_at_ = now_;
}

uint32_t Playback::take(l4d_playback_item* items, uint32_t capacity) {
  const size_t n = std::min<size_t>(capacity, queue_.size() - queue_begin_);
  std::copy_n(queue_.begin() + static_cast<ptrdiff_t>(queue_begin_), n, items);
  queue_begin_ += n;
  if (queue_begin_ == queue_.size() || queue_begin_ >= kQueueItems) {
    queue_.erase(queue_.begin(), queue_.begin() + static_cast<ptrdiff_t>(queue_begin_));
    queue_begin_ = 0;
  }
  return static_cast<uint32_t>(n);
}

void Playback::loaded(double now, uint32_t id, uint64_t units, l4d_status status) {
  advance(now);
  // Bytes that were evicted since are fetched again.
  const bool lacks = status == L4D_ERR_IO || status == L4D_ERR_NEED_DATA;
  const bool kept = status == L4D_OK || (settings_.tolerant && !lacks);
  const Residents::Bucket* const bucket = residents_.end_load(id, kept, units);
  if (bucket == nullptr) return;
  bytes_changed_ = sorts_ = true;
  wake_at_ = now_;
  if (kept) return;
  const BucketName name = bucket->name;
  Part* const part = presentation_.find(bucket->stream);
  if (!bucket->is_loaded) residents_.remove(name);
  if (lacks || part == nullptr) return;
  for (const Item& item : part->map.items()) {
    if (item.layer != name.layer || item.bucket != name.bucket) continue;
    for (size_t r = item.first; r < item.first + item.num_base; ++r) {
      Chunk& chunk = part->map.chunks()[part->map.refs()[r]];
      chunk.right = false;
      if (!part->ledger.lose(chunk.offset, chunk.size, L4D_CAUSE_CORRUPT, now_)) continue;
      chunk_events_.push_back(
          {L4D_EVENT_LOST, L4D_CAUSE_CORRUPT, part->entry.number, chunk.offset, chunk.size});
    }
  }
  add_chunk_events();
}

}  // namespace l4d::playback
