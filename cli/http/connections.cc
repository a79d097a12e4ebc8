// SPDX-License-Identifier: Apache-2.0
#include "cli/http/connections.h"

#include <sys/socket.h>

namespace l4d::cli {
namespace {

// One who takes bytes is not cut for another as long as it takes some.
constexpr std::chrono::seconds kStalled{1};

}  // namespace

Connections::One* Connections::begin(int socket) {
  const std::lock_guard<std::mutex> lock(mutex_);
  all_.emplace_back(socket);
  all_.back().place_ = std::prev(all_.end());
  make_room(all_.back());
  return &all_.back();
}

void Connections::end(One* one) {
  const std::lock_guard<std::mutex> lock(mutex_);
  all_.erase(one->place_);
}

void Connections::set_known(One* one) {
  const std::lock_guard<std::mutex> lock(mutex_);
  one->known_ = true;
}

void Connections::set(One* one, One::Waits waits) {
  const std::lock_guard<std::mutex> lock(mutex_);
  one->waits_ = waits;
  one->since_ = Clock::now();
}

void Connections::end_late() {
  const std::lock_guard<std::mutex> lock(mutex_);
  const Clock::time_point now = Clock::now();
  for (One& one : all_) {
    const Seconds most = one.waits_ == One::Waits::kForTaking ? kTaking
                         : one.known_                         ? kIdle
                                                              : kStranger;
    if (one.waits_ != One::Waits::kNo && now - one.since_ > most) shut_down(one);
  }
}

// Ends one connection where there are too many: `newest` itself if no other can go.
void Connections::make_room(One& newest) {
  size_t strangers = 0, open = 0;
  for (const One& one : all_) {
    open += !one.ending_;
    strangers += !one.ending_ && !one.known_;
  }
  if (open <= kMost && strangers <= kMostStrangers) return;
  One* goes = longest_waiting(true);
  if (goes == &newest && open > kMost) {
    One* known = longest_waiting(false);
    if (known != nullptr) goes = known;
  }
  shut_down(goes != nullptr ? *goes : newest);
}

// Null where none waits, or only those that are taking bytes.
Connections::One* Connections::longest_waiting(bool of_strangers) {
  const Clock::time_point stalled = Clock::now() - kStalled;
  One* longest = nullptr;
  for (One& one : all_) {
    if (one.ending_ || one.known_ == of_strangers || one.waits_ == One::Waits::kNo) continue;
    if (one.waits_ == One::Waits::kForTaking && one.since_ > stalled) continue;
    if (longest == nullptr || one.since_ < longest->since_) longest = &one;
  }
  return longest;
}

void Connections::shut_down(One& one) {
  if (one.ending_) return;
  one.ending_ = true;
  ::shutdown(one.socket_, SHUT_RDWR);
}

}  // namespace l4d::cli
