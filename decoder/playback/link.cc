// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/link.h"

#include <algorithm>
#include <cmath>

namespace l4d::playback {
namespace {

// How much longer than the measured throughput says the answers before may take.
constexpr double kPatience = 2;

// From 0.75 to 1.25, by the number of a request: many players that failed together come back one
// after the other, and the same calls give the same times.
double jitter_of(uint32_t id) {
  const uint64_t spread = id * 0x9e3779b97f4a7c15u;
  return 0.75 + 0.5 * static_cast<double>(spread >> 40) / double{1 << 24};
}

}  // namespace

void Link::open() {
  requests_.clear();
  failures_ = 0;
  is_down_ = false;
  hold_until_ = -1;
  alive_at_ = succeeded_at_ = -1e300;
}

Request* Link::find(uint32_t id) {
  for (Request& request : requests_) {
    if (request.id == id) return &request;
  }
  return nullptr;
}

const Request& Link::start(const WantedRange& range, bool whole, bool urgent, double now,
                           double throughput) {
  Request request;
  if (throughput > 0) {
    request.patience = kPatience * static_cast<double>(bytes_under_way()) / throughput;
  }
  request.id = ++last_id_;
  request.begin = request.at = whole ? 0 : range.begin;
  request.end = whole ? UINT64_MAX : range.end;
  request.urgency = range.urgency;
  request.rung = range.rung;
  request.fresh = range.fresh;
  request.chunk = range.chunk;
  request.part = range.part;
  request.whole = whole;
  request.urgent = urgent;
  request.sent = now;
  requests_.push_back(request);
  ++num_requests_;
  return requests_.back();
}

void Link::remove(uint32_t id) {
  requests_.erase(std::remove_if(requests_.begin(), requests_.end(),
                                 [id](const Request& r) { return r.id == id; }),
                  requests_.end());
}

double Link::add_failure(uint32_t id, double now, double retry_after, bool* went_down) {
  ++num_failures_;
  // Requests that were under way together fail for one cause, as when a machine has slept or a
  // server has ended: what fails before the next attempt is not another one.
  if (now >= hold_until_) ++failures_;
  const int doublings = static_cast<int>(std::min(failures_, 30u)) - 1;
  double delay = std::min(std::ldexp(options_.retry_delay, doublings), options_.max_retry_delay);
  *went_down = !is_down_ && failures_ >= options_.failures;
  is_down_ = is_down_ || *went_down;
  if (is_down_) delay = options_.max_retry_delay;
  delay = std::max(delay * jitter_of(id), retry_after);
  hold_until_ = std::max(hold_until_, now + delay);
  return delay;
}

bool Link::add_success(double now) {
  succeeded_at_ = now;
  const bool was_down = is_down_;
  failures_ = 0;
  is_down_ = false;
  return was_down;
}

// An answer that has no bytes yet may wait for those before it.
double Link::deadline_of(const Request& request) const {
  if (request.received > 0) return request.last_byte + options_.idle_timeout;
  const double urgent = std::min(options_.urgent_timeout, options_.first_byte_timeout);
  const double first = request.urgent ? urgent : options_.first_byte_timeout;
  const double timeout = request.answered ? options_.idle_timeout : first;
  const double begin = request.answered ? request.last_byte : request.sent;
  if (request.patience >= 0) return begin + request.patience + timeout;
  return std::max(begin, alive_at_) + timeout;
}

double Link::next_deadline() const {
  double next = HUGE_VAL;
  for (const Request& request : requests_) next = std::min(next, deadline_of(request));
  return next;
}

uint64_t Link::bytes_under_way() const {
  uint64_t bytes = 0;
  for (const Request& request : requests_) {
    if (!request.whole) bytes += request.end - std::min(request.at, request.end);
  }
  return bytes;
}

void Link::list_under_way(std::vector<UnderWay>* out) const {
  out->clear();
  for (const Request& request : requests_) {
    if (request.at >= request.end) continue;
    out->push_back({request.at, request.end, request.fresh, request.part});
  }
}

}  // namespace l4d::playback
