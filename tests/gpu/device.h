// SPDX-License-Identifier: Apache-2.0
// What every test on a device asks first.
#pragma once

#include <gtest/gtest.h>

#include "l4d/cuda.h"

namespace l4d::test {

// Whether CUDA's first device is one that this build has code for.
inline bool has_device() {
  l4d_cuda_device_info info = L4D_INIT(l4d_cuda_device_info);
  return l4d_cuda_get_device_info(0, &info) == L4D_OK && info.usable != 0;
}

// Tests of this fixture are skipped where there is no device.
template <typename Base>
class OnDevice : public Base {
 protected:
  void SetUp() override {
    if (!has_device()) GTEST_SKIP() << "no usable CUDA device";
  }
};

}  // namespace l4d::test
