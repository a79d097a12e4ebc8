// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "libl4dcodec/cuda/device.h"
#include "render/cuda/backward/gradient.h"
#include "render/cuda/importance/device_importance.h"

namespace l4d::render {

class ImportanceMemory : public DeviceImportance {
 public:
  // All sums are 0.
  Status create(size_t count, const ImportanceRow& row, bool sum_visible_only);
  Status read(Values* out) const override;
  Status read_seen(std::vector<uint8_t>* out) const override;
  Status read_visible_only(std::vector<int64_t>* out) const override;
  Status clone(std::unique_ptr<DeviceImportance>* out) const override;
  Status add(const DeviceImportance& other) override;
  const ImportanceSums& sums() const { return sums_; }

 private:
  size_t count_ = 0;
  cuda::DeviceMemory memory_[3];
  ImportanceSums sums_{};
};

}  // namespace l4d::render
