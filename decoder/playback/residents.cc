// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/residents.h"

#include <algorithm>

namespace l4d::playback {
namespace {

constexpr uint32_t kMoreSlots = 256;

}  // namespace

const Residents::Bucket* Residents::find(const BucketName& name) const {
  const uint32_t slot = slots_.find(key_of(name));
  return slot == Slots::kNone ? nullptr : &buckets_[slot];
}

const Residents::Bucket* Residents::find_any(uint32_t part) const {
  for (uint32_t slot = slots_.oldest(); slot != Slots::kNone; slot = slots_.next_newer(slot)) {
    if (buckets_[slot].name.slot == part) return &buckets_[slot];
  }
  return nullptr;
}

void Residents::clear() {
  slots_.clear();
  buckets_.clear();
  units_ = 0;
  num_loading_ = 0;
}

void Residents::use(const BucketName& name) {
  const uint32_t slot = slots_.find(key_of(name));
  if (slot == Slots::kNone) return;
  slots_.use(slot);
  buckets_[slot].epoch = epoch_;
}

const Residents::Bucket* Residents::victim() const {
  for (uint32_t slot = slots_.oldest(); slot != Slots::kNone; slot = slots_.next_newer(slot)) {
    if (buckets_[slot].epoch == epoch_) return nullptr;  // and all that were used later
    if (buckets_[slot].load == 0) return &buckets_[slot];
  }
  return nullptr;
}

void Residents::remove(const BucketName& name) {
  const uint32_t slot = slots_.find(key_of(name));
  if (slot == Slots::kNone) return;
  units_ -= buckets_[slot].units;
  if (buckets_[slot].load != 0) --num_loading_;
  slots_.remove(slot);
}

void Residents::begin_load(const BucketName& name, uint32_t stream, uint32_t id, uint32_t detail,
                           uint64_t units) {
  uint32_t slot = slots_.find(key_of(name));
  if (slot == Slots::kNone) {
    if (!slots_.has_free()) {
      buckets_.resize(slots_.capacity() + kMoreSlots);
      slots_.grow(kMoreSlots);
    }
    slot = slots_.insert(key_of(name));
    buckets_[slot] = {};
    buckets_[slot].name = name;
    buckets_[slot].stream = stream;
    buckets_[slot].units = rounded(units);
    units_ += buckets_[slot].units;
  }
  slots_.use(slot);
  buckets_[slot].epoch = epoch_;
  buckets_[slot].load = id;
  buckets_[slot].loading_detail = detail;
  ++num_loading_;
}

Residents::Bucket* Residents::end_load(uint32_t id, bool loaded, uint64_t units) {
  for (uint32_t slot = slots_.newest(); slot != Slots::kNone; slot = slots_.next_older(slot)) {
    Bucket& bucket = buckets_[slot];
    if (bucket.load != id) continue;
    bucket.load = 0;
    --num_loading_;
    if (loaded) {
      bucket.is_loaded = true;
      bucket.detail = bucket.loading_detail;
      units_ -= bucket.units;
      bucket.units = std::min(rounded(units), bucket.units);
      units_ += bucket.units;
    }
    return &bucket;
  }
  return nullptr;
}

}  // namespace l4d::playback
