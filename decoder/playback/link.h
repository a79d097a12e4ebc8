// SPDX-License-Identifier: Apache-2.0
// The requests that are under way to a source: their deadlines, what follows a failure, and how
// fast bytes arrive. It knows nothing of what the bytes are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "decoder/playback/planner.h"
#include "l4d/playback.h"

namespace l4d::playback {

struct Request {
  uint32_t id = 0;
  uint64_t begin = 0, end = 0;  // end: UINT64_MAX where it is that of the file
  uint64_t at = 0;              // of the next byte
  uint64_t useful = 0;          // bytes that were kept
  uint64_t chunk = 0;           // fresh: where the chunk begins
  Part* part = nullptr;         // null: the playlist
  Urgency urgency = Urgency::kNone;
  uint32_t rung = 0;
  bool fresh = false, whole = false, urgent = false;
  bool answered = false;
  double sent = 0, first_byte = -1, last_byte = -1;
  double patience = -1;  // seconds that the bytes before it may take; below 0: not known
  uint64_t received = 0;
};

struct LinkOptions {
  uint32_t failures = 5, max_requests = 6;
  double first_byte_timeout = 10, urgent_timeout = 3, idle_timeout = 5;
  double retry_delay = 0.25, max_retry_delay = 8;
};

class Link {
 public:
  explicit Link(const LinkOptions& options) : options_(options) {}

  // A new source: what was under way is forgotten.
  void open();
  const std::vector<Request>& requests() const { return requests_; }
  Request* find(uint32_t id);
  bool has_slot() const { return requests_.size() < (is_down_ ? 1 : options_.max_requests); }
  // Until when no request is to be made.
  double hold_until() const { return hold_until_; }
  bool is_down() const { return is_down_; }

  // throughput: bytes a second, 0 = not known.
  const Request& start(const WantedRange& range, bool whole, bool urgent, double now,
                       double throughput);
  // Bytes of any request have come.
  void set_alive(double now) { alive_at_ = now; }
  void remove(uint32_t id);
  // After a failure: no request until some time, later with each failure in a row. Returns how many
  // seconds that is. *went_down: whether the source counts as down from now on.
  double add_failure(uint32_t id, double now, double retry_after, bool* went_down);
  // An answer brought something. Returns whether the source was down.
  bool add_success(double now);
  // When that was last; -1e300: never.
  double succeeded_at() const { return succeeded_at_; }
  void retry() {
    hold_until_ = -1;
    failures_ = 0;
  }

  double deadline_of(const Request& request) const;
  // The first deadline; infinity: none.
  double next_deadline() const;
  // Bytes that are still to come.
  uint64_t bytes_under_way() const;
  void list_under_way(std::vector<UnderWay>* out) const;

  uint64_t num_requests() const { return num_requests_; }
  uint64_t num_failures() const { return num_failures_; }

 private:
  LinkOptions options_;
  std::vector<Request> requests_;  // in the order in which they were made
  uint32_t last_id_ = 0;
  uint32_t failures_ = 0;  // in a row
  bool is_down_ = false;
  double hold_until_ = -1;
  double alive_at_ = -1e300;  // when a byte came last
  double succeeded_at_ = -1e300;
  uint64_t num_requests_ = 0, num_failures_ = 0;
};

}  // namespace l4d::playback
