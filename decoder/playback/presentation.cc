// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/presentation.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace l4d::playback {
namespace {

constexpr uint32_t kSlots = uint32_t{1} << 24;
// Media members on a path. More of them are not looked at until it comes nearer.
constexpr size_t kMostStages = 16;

}  // namespace

void Presentation::close() {
  parts_.clear();
  is_playlist_ = false;
  list_ = Playlist();
  media_.clear();
  begin_ = 0;
  num_rungs_ = 1;
  sh_degree_ = 0;
}

Part& Presentation::open_stream(uint64_t file_size) {
  close();
  list_.members.resize(1);
  list_.uris.resize(1);
  media_.assign(1, 0);
  Part& part = make_part(list_.members[0]);
  part.begin(file_size);
  return part;
}

void Presentation::set_stream_span(double begin, double end) {
  Member& member = list_.members[0];
  member.begin = begin_ = begin;
  member.end = end;
  parts_[0]->entry = member;
}

void Presentation::open_playlist() {
  close();
  is_playlist_ = true;
}

void Presentation::index_media() {
  media_.clear();
  for (size_t k = 0; k < list_.members.size(); ++k) {
    if (list_.members[k].is_media) media_.push_back(static_cast<uint32_t>(k));
  }
}

// Adds to *next what has left the front of `before`, and is shown after `time`.
void Presentation::keep_front(double time, Playlist* next) const {
  std::vector<Member> kept;
  const auto keep = [&](const Member& member) {
    kept.push_back(member);
    Member& copy = kept.back();
    copy.first_need = next->needs.size();
    copy.uri = static_cast<uint32_t>(next->uris.size());
    const auto needs = list_.needs.begin() + static_cast<ptrdiff_t>(member.first_need);
    next->needs.insert(next->needs.end(), needs, needs + member.num_needs);
    next->uris.push_back(uri_of(member));
  };
  for (const uint32_t m : media_) {
    const Member& shown = list_.members[m];
    if (shown.begin >= begin_) break;
    if (shown.end <= time || next->find(shown.number) != nullptr) continue;
    keep(shown);
    for (size_t n = 0; n < shown.num_needs; ++n) {
      const uint32_t number = list_.needs[shown.first_need + n];
      const Member* const standing = list_.find(number);
      const bool known = std::any_of(kept.begin(), kept.end(),
                                     [number](const Member& k) { return k.number == number; });
      if (standing != nullptr && !known && next->find(number) == nullptr) keep(*standing);
    }
  }
  next->members.insert(next->members.end(), kept.begin(), kept.end());
  std::sort(next->members.begin(), next->members.end(),
            [](const Member& a, const Member& b) { return a.number < b.number; });
}

void Presentation::set_list(Playlist&& list, double time) {
  Playlist next = std::move(list);
  const auto first = std::find_if(next.members.begin(), next.members.end(),
                                  [](const Member& m) { return m.is_media; });
  if (first != next.members.end()) begin_ = first->begin;
  keep_front(time, &next);
  list_ = std::move(next);
  index_media();
  for (const auto& part : parts_) {
    const Member* const member = list_.find(part->entry.number);
    if (member != nullptr) part->entry = *member;
  }
}

size_t Presentation::media_at(double time) const {
  const auto after =
      std::upper_bound(media_.begin(), media_.end(), time,
                       [&](double t, uint32_t m) { return t < list_.members[m].begin; });
  const size_t k = static_cast<size_t>(after - media_.begin());
  if (k == 0) return 0;
  if (k == media_.size()) return k - 1;
  const double behind = time - media(k - 1).end;
  return behind >= 0 && media(k).begin - time < behind ? k : k - 1;
}

Interval Presentation::shown_of(size_t k) const {
  const auto border = [&](size_t next) {
    const double end = media(next - 1).end, begin = media(next).begin;
    return end < begin ? end + (begin - end) / 2 : begin;
  };
  return {k == 0 ? -HUGE_VAL : border(k), k + 1 == media_.size() ? HUGE_VAL : border(k + 1)};
}

Part* Presentation::find(uint32_t number) const {
  for (const auto& part : parts_) {
    if (part->entry.number == number) return part.get();
  }
  return nullptr;
}

void Presentation::find_parts(size_t k, std::vector<Part*>* out) const {
  out->clear();
  const Member& shown = media(k);
  out->push_back(find(shown.number));
  for (size_t n = 0; n < shown.num_needs; ++n) {
    out->push_back(find(list_.needs[shown.first_need + n]));
  }
}

Part& Presentation::make_part(const Member& member) {
  parts_.push_back(std::make_unique<Part>(member, is_playlist_, take_slot(), pool_, decoders_));
  return *parts_.back();
}

uint32_t Presentation::take_slot() {
  const uint32_t slot = next_slot_;
  next_slot_ = (next_slot_ + 1) % kSlots;
  return slot;
}

void Presentation::renew(Part* part) {
  part->slot = take_slot();
  part->blocks.set_number(part->slot);
  part->begin(part->entry.bytes > 0 ? part->entry.bytes : UINT64_MAX);
}

void Presentation::free_part(const Part* part) {
  parts_.erase(std::find_if(parts_.begin(), parts_.end(),
                            [part](const auto& p) { return p.get() == part; }));
}

void Presentation::meet(const Part& part) {
  num_rungs_ = std::max(num_rungs_, part.map.ladder().size());
  sh_degree_ = std::max(sh_degree_, uint32_t{part.decoder.file().header().sh_degree});
}

// segment: of the presentation, within what the k-th media member shows.
void Presentation::add_stage(size_t k, const Segment& segment, std::vector<Part*>* out) {
  const Member& shown = media(k);
  for (size_t n = 0; n <= shown.num_needs; ++n) {
    const Member* const member =
        n == 0 ? &shown : list_.find(list_.needs[shown.first_need + n - 1]);
    if (member == nullptr) continue;
    Part* part = find(member->number);
    if (part == nullptr) {
      part = &make_part(*member);
      part->begin(member->bytes > 0 ? member->bytes : UINT64_MAX);
    }
    // In a gap, what is seen at the end of the span.
    const bool whole = !is_playlist_;
    const auto own = [&](double time) {
      return part->time_of(whole ? time : std::clamp(time, shown.begin, shown.end));
    };
    if (part->segments.empty()) out->push_back(part);
    part->segments.push_back({own(segment.from), own(segment.to), segment.at});
    part->last_use = ++uses_;
  }
}

void Presentation::lay(const std::vector<Segment>& path, std::vector<Part*>* out) {
  out->clear();
  for (const auto& part : parts_) part->segments.clear();
  if (media_.empty()) return;
  size_t stages = 0;
  for (const Segment& segment : path) {
    const bool forwards = segment.forwards();
    const size_t last = media_at(segment.to);
    for (size_t k = media_at(segment.from);; k = forwards ? k + 1 : k - 1) {
      if (++stages > kMostStages) return;
      const Interval shown = shown_of(k);
      Segment piece = segment;
      if (k != last) piece.to = forwards ? shown.end : shown.begin;
      if (forwards) piece.from = std::max(piece.from, shown.begin);
      if (!forwards) piece.from = std::min(piece.from, shown.end);
      piece.at = segment.at + std::fabs(piece.from - segment.from);
      add_stage(k, piece, out);
      if (k == last) break;
    }
  }
}

}  // namespace l4d::playback
