// SPDX-License-Identifier: Apache-2.0
// Which warp decodes which part of which page, and which warps share a block of threads.
#pragma once

#include <vector>

#include "decoder/cuda/device_types.h"
#include "decoder/cuda/kernels.h"

namespace l4d::cuda {

struct WarpSchedule {
  std::vector<WarpTask> warps;
  std::vector<BlockTask> blocks;
  ChannelsLaunch launch;
};

// layers: of the tables, by index. detail_apart: SH detail needs nothing of the base chunk.
WarpSchedule schedule_warps(const std::vector<DevicePage>& pages,
                            const std::vector<DeviceLayer>& layers, bool detail_apart,
                            uint32_t multiprocessors);

}  // namespace l4d::cuda
