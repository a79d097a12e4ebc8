// SPDX-License-Identifier: Apache-2.0
// What Playback does with bytes.
#include <algorithm>
#include <cmath>

#include "decoder/playback/playback.h"

namespace l4d::playback {
namespace {

constexpr uint64_t kReadGap = 64 << 10, kReadBytes = 1 << 20;  // of a local file

}  // namespace

// Bytes that take the place of wrong ones.
void Playback::receive_fresh(Request* request, ByteSpan data) {
  const uint64_t n = std::min<uint64_t>(data.size(), request->end - request->at);
  Part* const part = request->part;
  Ledger::Entry* const entry = part->ledger.find(request->chunk);
  wasted_bytes_ += data.size() - n;
  if (entry == nullptr || entry->next != request->at) {
    wasted_bytes_ += n;
    request->at += n;
    return;
  }
  part->map.expect_check();
  part->blocks.overwrite(request->at, data.subspan(0, static_cast<size_t>(n)));
  request->at += n;
  request->useful += n;
  entry->next = request->at;
  const uint64_t begin = entry->offset;
  // Before its last byte, the chunk is not looked at.
  part->map.check(begin, request->at, now_, &chunk_events_);
}

// Of a whole file: what of it takes the place of wrong bytes.
void Playback::replace_wrong(Part* part, uint64_t offset, ByteSpan data) {
  const uint64_t end = offset + data.size();
  for (size_t k = 0; k < part->ledger.entries().size(); ++k) {
    Ledger::Entry* const entry = part->ledger.find(part->ledger.entries()[k].offset);
    if (entry->lost || entry->next < offset || entry->next >= end) continue;
    const uint64_t until = std::min(end, entry->offset + entry->size);
    if (until <= entry->next) continue;
    part->blocks.overwrite(entry->next, data.subspan(static_cast<size_t>(entry->next - offset),
                                                     static_cast<size_t>(until - entry->next)));
    entry->next = until;
  }
}

void Playback::store(Request* request, ByteSpan data) {
  Part* const part = request->part;
  const uint64_t n = std::min<uint64_t>(data.size(), request->end - request->at);
  const ByteSpan kept = data.subspan(0, static_cast<size_t>(n));
  const uint64_t before = blocks_.num_stored();
  part->map.expect_check();
  if (request->whole && request->fresh) replace_wrong(part, request->at, kept);
  uint64_t done = part->blocks.append(request->at, kept);
  if (done < n && blocks_.is_full() && (!part->no_ranges || presentation_.is_playlist())) {
    // What the path needs stays, all else may go.
    blocks_.begin_epoch();
    planner_.use_blocks();
    done += part->blocks.append(
        request->at + done, kept.subspan(static_cast<size_t>(done), static_cast<size_t>(n - done)));
  }
  const uint64_t stored = blocks_.num_stored() - before;
  request->useful += stored;
  wasted_bytes_ += data.size() - stored;
  const uint64_t at = request->at;
  const bool whole = request->whole, full = done < n && blocks_.is_full();
  request->at += n;
  part->map.check(at, at + n, now_, &chunk_events_);
  if (whole && full) fail_source(part, L4D_CAUSE_LIMIT, HUGE_VAL);
}

void Playback::received(double now, uint32_t id, ByteSpan data) {
  advance(now);
  Request* const request = link_.find(id);
  if (request == nullptr || data.empty()) return;
  wake_at_ = now_;
  if (request->first_byte < 0) request->first_byte = now_;
  request->answered = true;
  request->last_byte = now_;
  link_.set_alive(now_);
  request->received += data.size();
  received_bytes_ += data.size();
  if (request->part == nullptr) {
    receive_list(data);
    return;
  }
  bytes_changed_ = true;
  if (request->fresh && !request->whole) {
    receive_fresh(request, data);
  } else {
    store(request, data);
  }
  add_chunk_events();
}

// From a local file, until nothing is wanted.
void Playback::read_wanted() {
  constexpr size_t kMostReads = 4096;
  Bytes bytes;
  for (size_t reads = 0; reads < kMostReads; ++reads) {
    const WantedRange range = planner_.find_wanted({}, {kReadGap, kReadBytes}, now_, &waits_until_);
    if (range.urgency == Urgency::kNone) return;
    bytes.resize(static_cast<size_t>(range.end - range.begin));
    const int64_t got = reader_.read_at(reader_.user, bytes.data(), bytes.size(), range.begin);
    if (got <= 0) {
      fail_stream(L4D_CAUSE_NETWORK, now_ + options_.max_retry_delay);
      return;
    }
    const ByteSpan data(bytes.data(), static_cast<size_t>(got));
    Request request;
    request.begin = request.at = range.begin;
    request.end = range.end;
    request.chunk = range.chunk;
    request.part = range.part;
    received_bytes_ += data.size();
    bytes_changed_ = true;
    if (range.fresh) {
      receive_fresh(&request, data);
    } else {
      store(&request, data);
    }
    add_chunk_events();
    if (range.part->map.is_stale() || range.part->map.lost_header() != nullptr) {
      follow();
      sorts_ = true;
    }
    update_items(true);
    if (request.useful == 0) return;
  }
}

}  // namespace l4d::playback
