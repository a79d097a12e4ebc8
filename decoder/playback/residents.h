// SPDX-License-Identifier: Apache-2.0
// The buckets that the caller has decoded, and those that it has been asked to decode.
#pragma once

#include <cstdint>
#include <vector>

#include "decoder/playback/slots.h"

namespace l4d::playback {

// slot: of the part (Part::slot).
struct BucketName {
  uint32_t slot = 0, layer = 0, bucket = 0;
};

class Residents {
 public:
  struct Bucket {
    BucketName name;
    uint32_t stream = 0;
    uint32_t load = 0;  // id of the LOAD that is out; 0: none
    uint32_t loading_detail = 0;
    bool is_loaded = false;
    uint32_t detail = 0;  // L4D_DETAIL_*, where it is loaded
    uint64_t units = 0;   // that it takes, or may take
    uint32_t epoch = 0;   // of the path that last needed it
  };

  // max_units: UINT64_MAX = no limit
  void set_limits(uint64_t max_units, uint32_t grain) {
    max_units_ = max_units;
    grain_ = grain;
  }
  const Bucket* find(const BucketName& name) const;
  // Any of a part; null where there is none.
  const Bucket* find_any(uint32_t slot) const;
  void clear();
  uint64_t units() const { return units_; }
  uint64_t max_units() const { return max_units_; }
  uint32_t num_loading() const { return num_loading_; }
  uint64_t rounded(uint64_t units) const { return (units + grain_ - 1) / grain_ * grain_; }

  // The path needs the bucket.
  void use(const BucketName& name);
  void begin_epoch() { ++epoch_; }
  // Whether `units` more fit, if this many can be unloaded before.
  bool fits(uint64_t units) const { return rounded(units) <= max_units_ - units_; }
  // The bucket that was needed longest ago and is not needed now; null: there is none.
  const Bucket* victim() const;
  void remove(const BucketName& name);
  void begin_load(const BucketName& name, uint32_t stream, uint32_t id, uint32_t detail,
                  uint64_t units);
  // Null where no such load is out.
  Bucket* end_load(uint32_t id, bool loaded, uint64_t units);

 private:
  // Layers are fewer than 256, slots than 2^24.
  static uint64_t key_of(const BucketName& name) {
    return uint64_t{name.slot} << 40 | uint64_t{name.layer} << 32 | name.bucket;
  }

  Slots slots_;
  std::vector<Bucket> buckets_;  // by slot
  uint64_t max_units_ = UINT64_MAX, units_ = 0;
  uint32_t grain_ = 1, epoch_ = 1, num_loading_ = 0;
};

}  // namespace l4d::playback
