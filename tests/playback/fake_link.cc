// SPDX-License-Identifier: Apache-2.0
#include "tests/playback/fake_link.h"

#include <algorithm>
#include <cmath>

namespace l4d::playback::test {

// A file may become another one while it is sent; a playlist that was read is as it was.
void FakeLink::look(double now, Transfer* t) {
  const bool is_list = (t->flags & L4D_REQUEST_PLAYLIST) != 0;
  if (t->file.bytes != nullptr && is_list) return;
  const Served file = content_.get(t->source, now);
  if (file.bytes != nullptr || t->file.bytes == nullptr) t->file = file;
}

double FakeLink::rate_at(double now) const {
  return now >= shape_.slow_from && now < shape_.slow_until ? shape_.slow_rate : shape_.rate;
}

void FakeLink::request(double now, const l4d_playback_item& item) {
  Transfer t;
  t.id = item.id;
  t.flags = item.flags;
  t.source = item.source;
  look(now, &t);
  const uint64_t size = t.file.bytes != nullptr ? t.file.bytes->size() : 0;
  const bool whole = !shape_.ranges || (item.flags & L4D_REQUEST_WHOLE) != 0;
  t.begin = t.at = whole ? 0 : item.offset;
  t.end = whole ? size : std::min<uint64_t>(item.offset + item.size, size);
  t.status = whole ? 200 : item.offset >= size ? 416 : 206;
  if (t.file.bytes == nullptr) t.status = 404;
  t.when = now + shape_.delay + shape_.jitter * random_.uniform();
  if (is_faulty(now)) {
    const double dice = random_.uniform();
    double sum = 0;
    const auto happens = [&](double share) {
      const bool hit = dice >= sum && dice < sum + share;
      sum += share;
      return hit;
    };
    const uint64_t length = t.end - std::min(t.at, t.end);
    t.stop = t.at + (length > 0 ? random_.below(static_cast<uint32_t>(length)) : 0);
    if (happens(faults_.loss)) t.fate = Transfer::kSilent;
    if (happens(faults_.cut)) t.fate = Transfer::kCut;
    if (happens(faults_.fail)) t.fate = Transfer::kBreaks;
    if (happens(faults_.stall)) t.fate = Transfer::kStalls;
    if (happens(faults_.busy) && t.status != 404) t.status = random_.below(2) == 0 ? 429 : 503;
    if (happens(faults_.wrong_range) && t.status == 206) t.begin = t.at = t.at / 2;
    if (faults_.not_found) t.status = random_.below(2) == 0 ? 404 : 410;
    if (faults_.forbidden) t.status = 403;
  }
  if (now >= faults_.down_from && now < faults_.down_until) t.fate = Transfer::kSilent;
  transfers_.push_back(t);
}

void FakeLink::cancel(uint32_t id) {
  transfers_.erase(std::remove_if(transfers_.begin(), transfers_.end(),
                                  [id](const Transfer& t) { return t.id == id; }),
                   transfers_.end());
}

double FakeLink::next_time() const {
  double next = HUGE_VAL;
  for (const Transfer& t : transfers_) {
    if (t.fate != Transfer::kSilent) next = std::min(next, t.when);
  }
  return next;
}

void FakeLink::answer(double now, Transfer* t, Playback* engine) {
  t->answered = true;
  l4d_answer a = L4D_INIT(l4d_answer);
  a.status = t->status;
  a.offset = t->status == 200 ? 0 : t->begin;
  look(now, t);
  const uint64_t size = t->file.bytes != nullptr ? t->file.bytes->size() : 0;
  a.version = t->file.version;
  if (shape_.totals) a.total_bytes = size;
  if (is_faulty(now) && random_.uniform() < faults_.wrong_total) a.total_bytes = size + 7;
  if (t->status == 429) a.retry_after = 1.5;
  engine->answered(now, t->id, a);
}

// When the next piece is here: the link is shared.
void FakeLink::schedule(double now, Transfer* t) {
  const uint64_t left = t->end - std::min(t->at, t->end);
  const uint64_t n = std::min(left, shape_.piece);
  free_at_ = std::max(free_at_, now) + static_cast<double>(n) / rate_at(now);
  t->when = free_at_ + shape_.jitter * 0.2 * random_.uniform();
  if (shape_.burst > 0) t->when = std::ceil(t->when / shape_.burst) * shape_.burst;
}

void FakeLink::send(double now, Transfer* t, Playback* engine) {
  look(now, t);
  const Bytes& file = *t->file.bytes;
  const uint64_t end = std::min<uint64_t>(t->end, file.size());
  const uint64_t n = std::min(end - std::min(t->at, end), shape_.piece);
  piece_.assign(file.begin() + static_cast<ptrdiff_t>(t->at),
                file.begin() + static_cast<ptrdiff_t>(t->at + n));
  const auto spoil = [&](uint64_t at, unsigned char by) {
    if (at >= t->at && at < t->at + n) piece_[static_cast<size_t>(at - t->at)] ^= by;
  };
  const bool is_list = (t->flags & L4D_REQUEST_PLAYLIST) != 0;
  for (const uint64_t at : faults_.damage) {
    if (!is_list) spoil(at, 0x40);
  }
  if (!is_list && now < faults_.sticky_until && (t->flags & L4D_REQUEST_FRESH) == 0) {
    spoil(faults_.sticky_at, 0x01);
  }
  if (n > 0 && !is_list && is_faulty(now) && random_.uniform() < faults_.garble) {
    spoil(t->at + random_.below(static_cast<uint32_t>(n)),
          static_cast<unsigned char>(1 + random_.below(255)));
  }
  t->at += n;
  bytes_sent_ += n;
  engine->received(now, t->id, ByteSpan(piece_.data(), piece_.size()));
}

void FakeLink::finish(size_t index, uint32_t outcome, double now, Playback* engine) {
  const uint32_t id = transfers_[index].id;
  transfers_.erase(transfers_.begin() + static_cast<ptrdiff_t>(index));
  engine->finished(now, id, outcome);
}

uint32_t FakeLink::step(double now, Playback* engine) {
  size_t index = transfers_.size();
  for (size_t i = 0; i < transfers_.size(); ++i) {
    if (transfers_[i].fate == Transfer::kSilent || transfers_[i].when > now) continue;
    if (index == transfers_.size() || transfers_[i].when < transfers_[index].when) index = i;
  }
  if (index == transfers_.size()) return 0;
  Transfer& t = transfers_[index];
  const uint32_t id = t.id;
  if (!t.answered) {
    answer(now, &t, engine);
    if (t.status != 200 && t.status != 206) {
      transfers_.erase(transfers_.begin() + static_cast<ptrdiff_t>(index));
      return id;
    }
    schedule(now, &t);
    return 0;
  }
  const bool stops = t.fate != Transfer::kWhole && t.at >= t.stop;
  if (stops && t.fate == Transfer::kStalls) {
    t.fate = Transfer::kSilent;
    return 0;
  }
  if (stops || t.at >= t.end || t.at >= t.file.bytes->size()) {
    finish(index, stops && t.fate == Transfer::kBreaks ? L4D_TRANSFER_FAILED : L4D_TRANSFER_ENDED,
           now, engine);
    return id;
  }
  send(now, &t, engine);
  schedule(now, &t);
  return 0;
}

}  // namespace l4d::playback::test
