// SPDX-License-Identifier: Apache-2.0
// Which sessions the simulator plays: l4d_playback_test --seeds=FIRST:LAST
#pragma once

#include <cstdint>

namespace l4d::playback::test {

struct Seeds {
  uint64_t first = 1, last = 500;
  bool goes_on = false;  // after a failure
};

Seeds& seeds();

}  // namespace l4d::playback::test
