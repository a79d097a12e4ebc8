// SPDX-License-Identifier: Apache-2.0
#pragma once

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
  // The target of the view on the device, valid until the next call with another `step`.
  Status take(const StepView& view, uint64_t step, cudaStream_t stream, const Target** out);
  uint64_t bytes() const { return bytes_; }
  void set_budget(uint64_t bytes) { budget_ = bytes; }

 private:
  Status make_room(uint64_t bytes, uint64_t step, cudaStream_t stream);

  using Key = std::tuple<uint64_t, uint32_t, uint32_t>;
  std::map<Key, Target> targets_;
  uint64_t budget_, bytes_ = 0;
};

}  // namespace l4d::train
