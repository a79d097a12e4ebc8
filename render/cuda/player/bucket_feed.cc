// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/player/bucket_feed.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "libl4dcodec/base/c_api.h"
#include "libl4dcodec/base/first_versions.h"
#include "render/cuda/player/player_status.h"

namespace l4d::render {
namespace {

constexpr uint32_t kMaxLoads = 128;
// The engine hears of the time in steps of the presentation.
constexpr double kMostStep = 0.25;
constexpr double kLocalAhead = 0.5, kLinkAhead = 6;
constexpr double kFarAway = 1e12;  // seconds, of a time that is to be clamped later

}  // namespace

// ---- beginning and end -------------------------------------------------------------------------

Status BucketFeed::make_engine(const l4d_cuda_player_options& options) {
  l4d_playback_options o = api::read_optional(options.playback);
  o.loader = L4D_LOADER_CALLER;
  o.unit_grain = residents_.chunk_slots();
  o.max_loads = kMaxLoads;
  o.strict = 1;
  if (o.ahead == 0) o.ahead = is_local_ ? kLocalAhead : kLinkAhead;
  o.start_ahead = o.ahead;  // nobody plays by the clock of the engine
  if (o.max_units > 0) {
    most_chunks_ = static_cast<uint32_t>(std::min(o.max_units, kMostSlots) / o.unit_grain);
    if (most_chunks_ == 0) return Status(L4D_ERR_LIMIT_EXCEEDED, "max_units is below one chunk");
    o.max_units = uint64_t{most_chunks_} * o.unit_grain;
  }
  ahead_ = o.ahead;
  step_ = std::min(kMostStep, ahead_ / 2);
  l4d_playback* engine = nullptr;
  L4D_RETURN_IF_ERROR(told(l4d_playback_create(&o, &engine)));
  engine_.reset(engine);
  l4d_quality quality = L4D_INIT(l4d_quality);
  quality.point = options.point;
  quality.fixed = options.automatic == 0 ? 1 : 0;
  quality.network = options.no_read_ahead != 0 ? L4D_NETWORK_INSTANT : L4D_NETWORK_ALL;
  L4D_RETURN_IF_ERROR(told(l4d_playback_set_quality(engine, now(), &quality)));
  // All of the presentation, around and around.
  return told(l4d_playback_set_range(engine, now(), L4D_PLAY_LOOP, 1, 0));
}

Status BucketFeed::open(const l4d_cuda_player_options& options) {
  is_local_ = options.reader != nullptr;
  waits_ = options.no_wait == 0;
  L4D_RETURN_IF_ERROR(make_engine(options));
  L4D_RETURN_IF_ERROR(told(
      is_local_
          ? l4d_playback_open_reader(engine_.get(), now(), options.reader)
          : l4d_playback_open(engine_.get(), now(), options.uri, L4D_OPEN_STREAM, options.size)));
  woken_ = true;
  thread_ = std::thread([this] { work(); });
  if (!is_local_) return {};
  Lock lock(mutex_);
  to_caller_.wait(lock, [&] {
    return is_open_ || state_.stream == L4D_STREAM_FAILED || failure_.code() != L4D_OK ||
           !broken_.ok();
  });
  if (is_open_ || !broken_.ok()) return broken_;
  return state_.stream == L4D_STREAM_FAILED ? status_of_cause(state_.cause) : failure_;
}

void BucketFeed::stop() {
  if (!thread_.joinable()) return;
  {
    const Lock lock(mutex_);
    stop_ = true;
  }
  to_feed_.notify_all();
  thread_.join();
}

double BucketFeed::now() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

// ---- the thread that draws ---------------------------------------------------------------------

double BucketFeed::clamped(double time) const {
  return is_open_ ? std::clamp(time, state_.begin, state_.end)
                  : std::clamp(time, -kFarAway, kFarAway);
}

bool BucketFeed::is_ready(double time) const {
  time = clamped(time);
  return std::any_of(ready_.begin(), ready_.end(), [&](const l4d_time_span& span) {
    return span.begin <= time && time <= span.end;
  });
}

void BucketFeed::ask(double time) {
  ++asked_;
  asked_time_ = clamped(time);
  to_feed_.notify_all();
}

Status BucketFeed::await(double time, Lock* lock) {
  if (is_ready(time)) {
    if (!(std::fabs(clamped(time) - asked_time_) < step_)) ask(time);
    return broken_;
  }
  if (!broken_.ok()) return broken_;
  const bool is_asked = asked_ > 0 && asked_time_ == clamped(time);
  if (!waits_ && is_asked) {
    if (failed_ != asked_) return Status(L4D_ERR_NEED_DATA, "the instant is not here yet");
    if (std::exchange(may_retry_, false)) asked_time_ = NAN;  // with the next call
    return failure_;
  }
  urgent_ = true;
  ask(time);
  if (!waits_) return Status(L4D_ERR_NEED_DATA, "the instant is not here yet");
  const double begin = now();
  to_caller_.wait(*lock, [&] { return is_ready(time) || failed_ == asked_ || !broken_.ok(); });
  ++counters_.stalls;
  counters_.stall_seconds += now() - begin;
  if (!broken_.ok()) return broken_;
  return is_ready(time) ? Status() : failure_;
}

void BucketFeed::count(l4d_cuda_player_counters* out) const {
  out->stalls = counters_.stalls;
  out->stall_seconds = counters_.stall_seconds;
  out->buckets_decoded = counters_.buckets_decoded;
  out->gaussians_decoded = counters_.gaussians_decoded;
  out->resident_gaussians = residents_.slots();
}

// ---- any thread --------------------------------------------------------------------------------

void BucketFeed::wake() {
  {
    const Lock lock(mutex_);
    woken_ = true;
  }
  to_feed_.notify_all();
}

template <typename Body>
l4d_status BucketFeed::on_engine(const Body& body) {
  l4d_status status = L4D_OK;
  {
    const Lock engine(engine_mutex_);
    status = body(engine_.get(), now());
  }
  wake();
  return status;
}

uint32_t BucketFeed::take(l4d_playback_item* items, uint32_t capacity) {
  bool was_full = false;
  size_t n = 0;
  {
    const Lock engine(engine_mutex_);
    was_full = link_items_.size() >= kLinkItems;
    n = std::min<size_t>(capacity, link_items_.size());
    std::copy_n(link_items_.begin(), n, items);
    link_items_.erase(link_items_.begin(), link_items_.begin() + static_cast<std::ptrdiff_t>(n));
  }
  if (was_full) wake();
  return static_cast<uint32_t>(n);
}

l4d_status BucketFeed::answered(uint32_t id, const l4d_answer* answer) {
  return on_engine(
      [&](l4d_playback* p, double t) { return l4d_playback_answered(p, t, id, answer); });
}

l4d_status BucketFeed::received(uint32_t id, const void* data, size_t n) {
  return on_engine(
      [&](l4d_playback* p, double t) { return l4d_playback_received(p, t, id, data, n); });
}

l4d_status BucketFeed::finished(uint32_t id, uint32_t outcome) {
  return on_engine(
      [&](l4d_playback* p, double t) { return l4d_playback_finished(p, t, id, outcome); });
}

l4d_status BucketFeed::set_rate(double rate) {
  const l4d_status status =
      on_engine([&](l4d_playback* p, double t) { return l4d_playback_set_rate(p, t, rate); });
  if (status != L4D_OK) return status;
  const Lock lock(mutex_);
  step_ = std::min(kMostStep, ahead_ * std::fabs(rate) / 2);
  return L4D_OK;
}

l4d_playback_state BucketFeed::state() const {
  const Lock lock(mutex_);
  return state_;
}

}  // namespace l4d::render
