// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <list>
#include <map>
#include <tuple>

#include "libl4dcodec/cuda/device.h"
#include "training/step/backend.h"

namespace l4d::train {

// Targets of steps on a device, those that were used last.
class TargetCache {
 public:
  struct Target {
    cuda::DeviceMemory rgb, alpha, mask;
    const uint8_t* alpha_or_null = nullptr;
    const uint8_t* mask_or_null = nullptr;
    uint64_t used = 0, bytes = 0;
  };
  explicit TargetCache(uint64_t budget) : budget_(budget) {}
  // The target of the view on the device, valid until the next call with another `step`. All calls
  // have the stream on which targets are read.
  Status take(const StepView& view, uint64_t step, cudaStream_t stream, const Target** out);
  uint64_t bytes() const { return bytes_; }
  void set_budget(uint64_t bytes) { budget_ = bytes; }

 private:
  using Key = std::tuple<uint64_t, uint32_t, uint32_t>;
  struct Entry {
    Target target;
    std::list<Key>::iterator place;
  };

  // Returns memory in `free` if some of `size`, which is that of `rgb`, `alpha` and `mask`, is
  // left.
  Status make_room(const uint64_t (&size)[3], uint64_t step, cudaStream_t stream, Target* free);

  std::map<Key, Entry> targets_;
  std::list<Key> order_;  // by last use, the oldest first
  uint64_t budget_, bytes_ = 0;
};

}  // namespace l4d::train
