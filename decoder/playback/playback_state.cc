// SPDX-License-Identifier: Apache-2.0
// What Playback can show, and what it says of itself.
#include <algorithm>
#include <cmath>

#include "decoder/playback/playback.h"
#include "decoder/session/shown_streams.h"

namespace l4d::playback {
namespace {

// The common parts of ascending, disjoint intervals.
void intersect(const std::vector<Interval>& a, std::vector<Interval>* b) {
  std::vector<Interval> out;
  for (const Interval& x : a) {
    for (const Interval& y : *b) {
      const Interval both{std::max(x.begin, y.begin), std::min(x.end, y.end)};
      if (both.begin <= both.end) out.push_back(both);  // an instant, too
    }
  }
  b->swap(out);
}

}  // namespace

// Of what one media member shows: all its streams must be ready. Times of a stream are rounded, so
// that its ends are compared in its own time.
ReadyInterval Playback::stage_interval(size_t stage, uint32_t rung, double time) const {
  const Member& shown = presentation_.media(stage);
  const bool whole = !presentation_.is_playlist();
  const double at = whole ? time : std::clamp(time, shown.begin, shown.end);
  ReadyInterval out{false, time, time};
  double from = -kInfinity, until = kInfinity;
  presentation_.find_parts(stage, &stage_);
  for (const Part* part : stage_) {
    if (part == nullptr || !part->is_on_path()) return out;
    const ReadyInterval own = planner_.ready_interval(*part, rung, part->time_of(at));
    if (!own.ready) return out;
    if (own.until < part->time_of(shown.end)) until = std::min(until, part->last_at(own.until));
    if (own.from > part->time_of(shown.begin)) from = std::max(from, part->first_at(own.from));
  }
  const Interval all = presentation_.shown_of(stage);
  out.ready = true;
  out.until = std::max(std::min(until, all.end), time);
  out.from = std::min(std::max(from, all.begin), time);
  return out;
}

ReadyInterval Playback::ready_interval(uint32_t rung, double time) const {
  if (!presentation_.has_media()) return {false, time, time};
  const size_t first = presentation_.media_at(time);
  ReadyInterval out = stage_interval(first, rung, time);
  if (!out.ready) return out;
  size_t last = first;
  while (last + 1 < presentation_.num_media() && out.until >= presentation_.shown_of(last).end) {
    const ReadyInterval more = stage_interval(last + 1, rung, presentation_.media(last + 1).begin);
    if (!more.ready) break;
    out.until = more.until;
    ++last;
  }
  size_t front = first;
  while (front > 0 && out.from <= presentation_.shown_of(front).begin) {
    const ReadyInterval more = stage_interval(front - 1, rung, presentation_.media(front - 1).end);
    if (!more.ready) break;
    out.from = more.from;
    --front;
  }
  // A border belongs to one side.
  while (presentation_.media_at(out.until) > last)
    out.until = std::nextafter(out.until, -kInfinity);
  while (presentation_.media_at(out.from) < front) out.from = std::nextafter(out.from, kInfinity);
  return out;
}

void Playback::find_ready() {
  const double time = clock_.position.time;
  ready_ = ready_interval(shown_, time);
  if (!ready_.ready) return;
  ready_.from = std::max(ready_.from, std::min(path_.begin(), time));
  ready_.until = std::min(ready_.until, std::max(path_.end(), time));
}

Status Playback::slice(double time, l4d_splat_buffers* out) {
  L4D_RETURN_IF_ERROR(check_open());
  if (options_.loader != L4D_LOADER_SLICES) {
    return Status(L4D_ERR_INVALID_STATE, "the caller keeps the buckets of this engine");
  }
  if (!ready_.ready || !(ready_.from <= time && time <= ready_.until)) {
    return Status(L4D_ERR_NEED_DATA, "the instant is not ready");
  }
  const size_t stage = presentation_.media_at(time);
  const Member& shown = presentation_.media(stage);
  presentation_.find_parts(stage, &stage_);
  if (!presentation_.is_playlist()) {
    Part* const part = stage_[0];
    out->point = part->map.ladder().point_of(part->rung_of(shown_), quality_.point.levels);
    return part->decoder.slicer().slice(time, out);
  }
  ShownStreams<l4d_splat_buffers> joined(presentation_.sh_degree(), out);
  for (Part* part : stage_) {
    if (!part->is_open() || part->is_lost()) continue;
    out->point = part->map.ladder().point_of(part->rung_of(shown_), quality_.point.levels);
    const double at = std::clamp(time, shown.begin, shown.end);
    L4D_RETURN_IF_ERROR(joined.add(part->decoder, part->time_of(at)));
  }
  return joined.finish();
}

l4d_playback_state Playback::state() const {
  l4d_playback_state s{};
  s.struct_size = sizeof s;
  s.stream = stream_;
  s.motion = clock_.motion;
  s.search = search_;
  s.cause = cause_;
  s.rung = shown_;
  s.num_rungs = has_begun_ ? presentation_.num_rungs() : 0;
  s.ready = ready_.ready ? 1 : 0;
  s.live = live_state_;
  if (has_begun_) {
    s.begin = presentation_.begin();
    s.end = presentation_.end();
  }
  s.anchor_time = clock_.position.time;
  s.anchor_now = clock_.anchor_now();
  s.velocity = clock_.velocity();
  s.ready_from = ready_.ready ? ready_.from : s.anchor_time;
  s.ready_until = ready_.ready ? ready_.until : s.anchor_time;
  s.wake_at = wake_at_;
  s.retry_at = stream_ == L4D_STREAM_FAILED ? retry_at_ : HUGE_VAL;
  s.throughput = choice_.throughput;
  s.round_trip = choice_.round_trip;
  s.waited_seconds = clock_.waited();
  s.received_bytes = received_bytes_;
  s.wasted_bytes = wasted_bytes_;
  s.requests = link_.num_requests();
  s.retries = link_.num_failures();
  s.waits = clock_.waits();
  s.memory_bytes = blocks_.memory_bytes();
  for (const auto& part : presentation_.parts()) {
    if (part->decoder.is_open()) s.memory_bytes += part->decoder.file().memory().used();
  }
  s.units = residents_.units();
  if (live_.grows() && has_begun_) {
    s.live_delay = live_.delay(now_, s.anchor_time);
    s.live_distance = live_.distance(now_);
  }
  s.sh_degree = presentation_.sh_degree();
  return s;
}

void Playback::buffered_stage(size_t stage, std::vector<Interval>* out) const {
  const Member& shown = presentation_.media(stage);
  out->assign(1, {std::max(shown.begin, path_.begin()), std::min(shown.end, path_.end())});
  std::vector<Interval> own;
  presentation_.find_parts(stage, &stage_);
  for (const Part* part : stage_) {
    if (part != nullptr && part->is_lost() && settings_.tolerant) continue;
    if (part == nullptr || !part->is_open() || !part->is_on_path()) {
      out->clear();
      return;
    }
    planner_.find_buffered(*part, shown_, &own);
    for (Interval& span : own) {
      span = {part->first_at(span.begin), part->last_at(span.end)};
      if (std::fabs(span.end - shown.end) < 1e-9) span.end = shown.end;
    }
    intersect(own, out);
  }
}

void Playback::buffered(std::vector<l4d_time_span>* out) const {
  out->clear();
  if (!has_begun_ || planner_.parts().empty()) return;
  std::vector<Interval> found;
  for (size_t k = 0; k < presentation_.num_media(); ++k) {
    const Part* const part = presentation_.find(presentation_.media(k).number);
    if (part == nullptr || !part->is_on_path()) continue;
    buffered_stage(k, &found);
    for (const Interval& span : found) {
      if (!out->empty() && out->back().end == span.begin) {
        out->back().end = span.end;
      } else if (span.begin <= span.end) {
        out->push_back({span.begin, span.end});
      }
    }
  }
}

void Playback::shown(double begin, double end, std::vector<l4d_shown_member>* out) const {
  out->clear();
  if (!has_begun_) return;
  const Playlist& list = presentation_.list();
  for (size_t k = presentation_.media_at(begin); k < presentation_.num_media(); ++k) {
    const Member& media = presentation_.media(k);
    if (media.begin > end) break;
    if (media.end < begin) continue;
    out->push_back({media.number, 0, media.begin, media.end, media.shift});
    for (size_t n = 0; n < media.num_needs; ++n) {
      const Member* const standing = list.find(list.needs[media.first_need + n]);
      if (standing == nullptr) continue;
      out->push_back({standing->number, 1, media.begin, media.end, standing->shift});
    }
  }
}

void Playback::losses(std::vector<l4d_playback_loss>* out) const {
  out->clear();
  for (const auto& part : presentation_.parts()) {
    const uint32_t stream = part->entry.number;
    if (part->is_lost()) out->push_back({stream, part->lost, 0, 0, part->retry_at});
    for (const Ledger::Entry& e : part->ledger.entries()) {
      if (e.lost) out->push_back({stream, e.cause, e.offset, e.size, e.at});
    }
  }
}

const char* Playback::uri(uint32_t source) const {
  if (source == 0) return uri_.c_str();
  const Member* const member = presentation_.list().find(source - 1);
  const bool known = presentation_.is_playlist() && member != nullptr;
  return known ? presentation_.uri_of(*member).c_str() : nullptr;
}

Decoder* Playback::decoder(uint32_t stream) const {
  const Part* const part = presentation_.find(stream);
  return part != nullptr && part->is_open() ? &part->decoder : nullptr;
}

}  // namespace l4d::playback
