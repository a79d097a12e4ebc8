// SPDX-License-Identifier: Apache-2.0
// What the thread of a feed does.
#include <algorithm>
#include <cmath>
#include <new>
#include <utility>

#include "libl4dcodec/base/c_api.h"
#include "libl4dcodec/base/checked.h"
#include "libl4dcodec/scene/prepare.h"
#include "render/cuda/player/bucket_feed.h"
#include "render/cuda/player/player_status.h"

namespace l4d::render {
namespace {

// Gaussians that are decoded at once, unless a bucket alone has more: it bounds the memory to work
// in, and how long a seek waits for what was begun before.
constexpr uint64_t kBatchRows = 1 << 17;
constexpr double kLongestWait = 3600;  // without a deadline
constexpr double kRetrySeconds = 0.1;

// Whether the headers are here; what follows them may have failed.
bool is_open(const l4d_playback_state& state) { return state.num_rungs > 0; }

// Of the stream's bytes: the engine knows what to do.
bool is_of_stream(l4d_status status) {
  return status == L4D_ERR_CORRUPT || status == L4D_ERR_CHECKSUM || status == L4D_ERR_TRUNCATED ||
         status == L4D_ERR_IO || status == L4D_ERR_NEED_DATA;
}

Status find_place(l4d_decoder* decoder, const l4d_bucket_span& span, BucketPlace* out) {
  l4d_layer_info layer = L4D_INIT(l4d_layer_info);
  L4D_RETURN_IF_ERROR(told(l4d_decoder_get_layer_info(decoder, span.layer, &layer)));
  if (span.layer != out->key.layer || span.bucket != out->key.bucket) {
    return Status(L4D_ERR_INTERNAL, "the directory has other buckets than the engine");
  }
  if (span.count > BucketFeed::kMostSlots) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, "a bucket of more than 2^30 - 1 slots");
  }
  out->slots = static_cast<uint32_t>(span.count);
  out->center = span.center;
  const double reach = layer.permanent != 0 ? HUGE_VAL : 2 * span.width;
  out->begin = span.center - reach;
  out->end = span.center + reach;
  out->group = (layer.tools & L4D_TOOL_MOTION) != 0             ? kMoving
               : (layer.tools & L4D_TOOL_TEMPORAL_OPACITY) != 0 ? kFading
                                                                : kStill;
  return {};
}

}  // namespace

void BucketFeed::work() {
  for (;;) {
    {
      Lock lock(mutex_);
      const auto has_work = [&] {
        return stop_ || (broken_.ok() && (woken_ || asked_ != sought_ || state_.wake_at <= now() ||
                                          (!loads_.empty() && !paused_)));
      };
      const double wait =
          broken_.ok() ? std::clamp(state_.wake_at - now(), 0.0, kLongestWait) : kLongestWait;
      to_feed_.wait_for(lock, std::chrono::duration<double>(wait), has_work);
      if (stop_) return;
      if (!has_work()) continue;
    }
    lost_items_ = true;
    const Status status = api::guard([&] {
      Status done = drive();
      if (done.ok() && !paused_) done = load(next_batch());
      lost_items_ = false;
      return done;
    });
    if (lost_items_) start_over();
    if (!status.ok()) fail(status);
  }
}

// What cannot be blamed on the stream fails the call that waits, and is tried again for the next
// one.
void BucketFeed::fail(const Status& status) {
  paused_ = true;
  const Lock lock(mutex_);
  failed_ = sought_;
  failure_ = status;
  may_retry_ = true;
  state_.wake_at = std::max(state_.wake_at, now() + kRetrySeconds);
  to_caller_.notify_all();
}

// Memory has run out, and nobody knows which items of the engine that concerned.
void BucketFeed::start_over() {
  {
    const Lock engine(engine_mutex_);
    loads_.clear();
    static_cast<void>(l4d_playback_refresh(engine_.get(), now()));
  }
  const Lock lock(mutex_);
  residents_.clear();
  ready_.clear();
  ++revision_;
}

// Tells the engine what is wanted, and takes what it wants.
Status BucketFeed::drive() {
  double time = 0;
  bool urgent = false;
  const uint32_t last = sought_;
  {
    const Lock lock(mutex_);
    woken_ = false;
    urgent = std::exchange(urgent_, false);
    sought_ = asked_;
    time = asked_time_;
  }
  const Lock engine(engine_mutex_);
  const double at = now();
  if (sought_ != last) {
    paused_ = false;
    if (urgent) give_back(at);
    L4D_RETURN_IF_ERROR(told(l4d_playback_seek(engine_.get(), at, time, 0, sought_)));
  }
  L4D_RETURN_IF_ERROR(told(l4d_playback_update(engine_.get(), at)));
  std::vector<BucketKey> unloads;
  Status failed;
  uint32_t failed_id = 0;
  take_items(at, &unloads, &failed, &failed_id);
  l4d_playback_state state = L4D_INIT(l4d_playback_state);
  L4D_RETURN_IF_ERROR(told(l4d_playback_get_state(engine_.get(), &state)));
  std::vector<l4d_time_span> ready(16);
  uint64_t num_ready = 0;
  L4D_RETURN_IF_ERROR(
      told(l4d_playback_get_buffered(engine_.get(), ready.data(), ready.size(), &num_ready)));
  if (num_ready > ready.size()) {
    ready.resize(num_ready);
    L4D_RETURN_IF_ERROR(
        told(l4d_playback_get_buffered(engine_.get(), ready.data(), ready.size(), &num_ready)));
  }
  ready.resize(num_ready);
  Status broken;
  if (is_open(state) && !is_store_open_) broken = open_store(0);
  if (state.stream == L4D_STREAM_FAILED && state.cause == L4D_CAUSE_CHANGED) {
    broken = status_of_cause(state.cause);
  }
  const Lock lock(mutex_);
  for (const BucketKey& key : unloads) residents_.remove(key);
  if (!unloads.empty()) ++revision_;
  state_ = state;
  ready_ = std::move(ready);
  is_open_ = is_open_ || is_store_open_;
  if (failed_id != 0) {
    failed_ = failed_id;
    failure_ = std::move(failed);
  }
  if (!broken.ok()) broken_ = std::move(broken);
  to_caller_.notify_all();
  return {};
}

// Loads that have not begun: the engine asks again for those that it still wants.
void BucketFeed::give_back(double now) {
  for (const BucketPlace& b : loads_) {
    if (l4d_playback_loaded(engine_.get(), now, b.id, 0, L4D_ERR_NEED_DATA) != L4D_OK) {
      throw std::bad_alloc();
    }
  }
  loads_.clear();
}

void BucketFeed::take_items(double now, std::vector<BucketKey>* unloads, Status* failed,
                            uint32_t* failed_id) {
  l4d_playback_item item{};
  uint32_t count = 1;
  while (link_items_.size() < kLinkItems &&
         l4d_playback_take(engine_.get(), &item, 1, &count) == L4D_OK && count == 1) {
    const BucketKey key{item.stream, item.layer, item.bucket};
    if (item.kind == L4D_ITEM_UNLOAD) {
      unloads->push_back(key);
    } else if (item.kind == L4D_ITEM_LOAD) {
      BucketPlace load;
      load.key = key;
      load.id = item.id;
      load.detail = item.detail;
      load.units = item.units;
      load.urgent = item.needed_at <= now;
      loads_.push_back(std::move(load));
    } else if (item.kind == L4D_ITEM_EVENT && item.event == L4D_EVENT_FAILED) {
      *failed = status_of_cause(item.cause);
      *failed_id = item.id;
    } else if (item.kind == L4D_ITEM_EVENT && item.event == L4D_EVENT_SHOWN) {
      // Nobody gets this: the instant is among what is ready.
      *failed = Status(L4D_ERR_INTERNAL, "the engine shows an instant that is not ready");
      *failed_id = item.id;
    } else if (!is_local_ && !(item.kind == L4D_ITEM_EVENT && item.event == L4D_EVENT_REPLACED)) {
      link_items_.push_back(item);
    }
  }
}

Status BucketFeed::open_store(uint32_t stream) {
  l4d_decoder* decoder = nullptr;
  L4D_RETURN_IF_ERROR(told(l4d_playback_get_decoder(engine_.get(), stream, &decoder)));
  const Lock lock(mutex_);
  L4D_RETURN_IF_ERROR(store_.open(decoder));
  if (most_chunks_ > 0) L4D_RETURN_IF_ERROR(store_.reserve(most_chunks_));
  residents_.grow(most_chunks_);
  is_store_open_ = true;
  return {};
}

// The next loads that can be decoded together. Those that the instant needs do not wait for others.
BucketFeed::Batch BucketFeed::next_batch() {
  Batch batch;
  uint64_t slots = 0;
  while (!loads_.empty()) {
    const BucketPlace& next = loads_.front();
    slots += next.units;
    if (!batch.empty() &&
        (slots > kBatchRows || next.urgent != batch[0].urgent || next.detail != batch[0].detail ||
         next.key.stream != batch[0].key.stream)) {
      break;
    }
    batch.push_back(next);
    loads_.pop_front();
  }
  std::sort(batch.begin(), batch.end(),
            [](const BucketPlace& a, const BucketPlace& b) { return a.key < b.key; });
  return batch;
}

Status BucketFeed::load(Batch batch) {
  if (batch.empty()) return {};
  Status status = load_whole(&batch);
  if (batch.size() > 1 && is_of_stream(status.code())) {
    // Which of them is it?
    for (BucketPlace& b : batch) L4D_RETURN_IF_ERROR(load({std::move(b)}));
    return {};
  }
  // Other failures say nothing of the stream.
  const bool is_known = status.ok() || is_of_stream(status.code());
  const l4d_status code = is_known ? status.code() : L4D_ERR_NEED_DATA;
  {
    const Lock engine(engine_mutex_);
    for (const BucketPlace& b : batch) {
      const uint64_t slots = status.ok() ? b.slots : 0;
      if (l4d_playback_loaded(engine_.get(), now(), b.id, slots, code) != L4D_OK) {
        throw std::bad_alloc();
      }
    }
  }
  const Lock lock(mutex_);
  for (const BucketPlace& b : batch) {
    ResidentBucket* const there = residents_.find(b.key);
    if (there == nullptr) continue;
    if (status.ok()) {
      there->filled = true;
      ++counters_.buckets_decoded;
      counters_.gaussians_decoded += b.slots;
    } else if (!there->filled) {
      residents_.remove(b.key);
    }
  }
  ++revision_;
  woken_ = true;
  return is_known ? Status() : status;
}

// Learns what the stream says of a batch, and has its bytes read.
Status BucketFeed::prepare(Batch* batch) {
  const Lock engine(engine_mutex_);
  l4d_decoder* decoder = nullptr;
  const BucketPlace& first = (*batch)[0];
  L4D_RETURN_IF_ERROR(told(l4d_playback_get_decoder(engine_.get(), first.key.stream, &decoder)));
  std::vector<l4d_bucket> buckets;
  for (const BucketPlace& b : *batch) buckets.push_back({b.key.layer, b.key.bucket});
  l4d_query query = L4D_INIT(l4d_query);
  query.kind = L4D_QUERY_BUCKETS;
  query.buckets = buckets.data();
  query.num_buckets = buckets.size();
  query.point.detail = first.detail;
  std::vector<l4d_bucket_span> spans(buckets.size());
  uint64_t count = 0, gaussians = 0;
  L4D_RETURN_IF_ERROR(
      told(l4d_decoder_get_spans(decoder, &query, spans.data(), spans.size(), &count)));
  if (count != batch->size()) {
    return Status(L4D_ERR_INTERNAL, "the directory has other buckets than the engine");
  }
  for (size_t k = 0; k < spans.size(); ++k) {
    L4D_RETURN_IF_ERROR(find_place(decoder, spans[k], &(*batch)[k]));
    gaussians += spans[k].count;
  }
  return store_.prepare(decoder, query, gaussians);
}

Status BucketFeed::load_whole(Batch* batch) {
  L4D_RETURN_IF_ERROR(prepare(batch));
  L4D_RETURN_IF_ERROR(store_.decode());
  L4D_RETURN_IF_ERROR(put(batch));
  return store_.finish();
}

// Chunks for all buckets of a batch, and what goes into them.
Status BucketFeed::put(Batch* batch) {
  Lock lock(mutex_);
  bool shown = false;
  for (BucketPlace& b : *batch) {
    ResidentBucket* there = residents_.find(b.key);
    if (there != nullptr && there->slots != b.slots) {
      return Status(L4D_ERR_INTERNAL, "a bucket has another size than before");
    }
    shown = shown || (there != nullptr && there->filled);
    if (there == nullptr) L4D_RETURN_IF_ERROR(make_room(b, &there));
    there->begin = b.begin;
    there->end = b.end;
    there->group = b.group;
    b.chunks = there->chunks;
  }
  // In another detail, a bucket stays where it is, and frames may be showing it.
  if (!shown) lock.unlock();
  return store_.place(*batch, shown);
}

Status BucketFeed::make_room(const BucketPlace& bucket, ResidentBucket** out) {
  *out = residents_.add(bucket.key, bucket.slots);
  if (*out != nullptr) return {};
  if (most_chunks_ > 0) return Status(L4D_ERR_INTERNAL, "the engine loads more than max_units");
  const uint64_t wanted = uint64_t{residents_.used()} + residents_.chunks_of(bucket.slots);
  const uint32_t chunks = saturate32(wanted + residents_.capacity() / 16);
  L4D_RETURN_IF_ERROR(store_.reserve(chunks));
  residents_.grow(chunks);
  *out = residents_.add(bucket.key, bucket.slots);
  return {};
}

}  // namespace l4d::render
