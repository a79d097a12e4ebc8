// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/warp_schedule.h"

#include <algorithm>

namespace l4d::cuda {

// Pages of a layer share its tables, which a block of threads keeps in shared memory; as long as
// there are fewer pages than multiprocessors each gets one for itself. Long pages go first, and
// beside others as long.
WarpSchedule schedule_warps(const std::vector<DevicePage>& pages,
                            const std::vector<DeviceLayer>& layers, bool detail_apart,
                            uint32_t multiprocessors) {
  WarpSchedule out;
  const auto cost = [&](const WarpTask& w) {
    const DevicePage& page = pages[w.page];
    return uint64_t{(w.parts & 1) != 0 ? page.chunk_bytes[0] : 0} +
           ((w.parts & 2) != 0 ? page.chunk_bytes[1] : 0);
  };
  for (uint32_t p = 0; p < pages.size(); ++p) {
    const bool detail = pages[p].chunk_bytes[1] != 0;
    out.warps.push_back({p, detail && !detail_apart ? 3u : 1u});
    if (detail && detail_apart) out.warps.push_back({p, 2u});
  }
  if (out.warps.empty()) return out;
  std::stable_sort(out.warps.begin(), out.warps.end(), [&](const WarpTask& a, const WarpTask& b) {
    const uint32_t la = pages[a.page].layer, lb = pages[b.page].layer;
    return la != lb ? la < lb : cost(a) > cost(b);
  });
  const size_t each = (out.warps.size() + multiprocessors - 1) / multiprocessors;
  // Of blocks that leave room for another one beside them, small ones: the device takes the next
  // one as soon as one has ended.
  const auto shared_bytes = [&](uint32_t block_pages) {
    uint32_t most = 0;
    for (const WarpTask& w : out.warps) {
      most = std::max(most, channels_shared_bytes(layers[pages[w.page].layer], block_pages));
    }
    return most;
  };
  const bool large = 2 * shared_bytes(kFewBlockPages) > kSharedBytes &&
                     shared_bytes(kMaxBlockPages) <= kSharedBytes;
  out.launch.block_pages =
      static_cast<uint32_t>(std::min<size_t>(each, large ? kMaxBlockPages : kFewBlockPages));
  out.launch.shared_bytes = shared_bytes(out.launch.block_pages);
  for (uint32_t w = 0; w < out.warps.size(); ++w) {
    const uint32_t layer = pages[out.warps[w].page].layer;
    if (out.blocks.empty() || out.blocks.back().layer != layer ||
        out.blocks.back().count == out.launch.block_pages) {
      out.blocks.push_back({layer, w, 0});
    }
    ++out.blocks.back().count;
  }
  std::stable_sort(out.blocks.begin(), out.blocks.end(),
                   [&](const BlockTask& a, const BlockTask& b) {
                     return cost(out.warps[a.first]) > cost(out.warps[b.first]);
                   });
  out.launch.num_blocks = static_cast<uint32_t>(out.blocks.size());
  return out;
}

}  // namespace l4d::cuda
