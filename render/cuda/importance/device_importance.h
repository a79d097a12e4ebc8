// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "libl4dcodec/base/status.h"

namespace l4d::render {

// Sums over views of importances, in device memory and whole numbers (importance_numbers.h).
class DeviceImportance {
 public:
  virtual ~DeviceImportance() = default;
  // Of all Gaussians, in images with their pixels counted one by one; host arrays.
  struct Values {
    std::vector<int64_t> numbers;       // [N, width]
    std::vector<int64_t> visible_only;  // [N] coverage in visibility-only views
    std::vector<uint8_t> seen;          // [N]
  };
  virtual Status read(Values* out) const = 0;
  virtual Status read_seen(std::vector<uint8_t>* out) const = 0;  // [N]
  // [N], as Values::visible_only.
  virtual Status read_visible_only(std::vector<int64_t>* out) const = 0;
  virtual Status clone(std::unique_ptr<DeviceImportance>* out) const = 0;
  // Adds the sums of another one on the same device.
  virtual Status add(const DeviceImportance& other) = 0;
};

}  // namespace l4d::render
