// SPDX-License-Identifier: Apache-2.0
// Where everything of a request lies in its workspace, of which the first bytes are the upload.
#pragma once

#include <array>
#include <vector>

#include "decoder/cuda/decode_request.h"
#include "decoder/cuda/host_pages.h"
#include "decoder/cuda/warp_schedule.h"

namespace l4d::cuda {

// Where an array of T begins in a workspace.
template <typename T>
struct ArrayAt {
  uint64_t offset = 0;
  T* in(unsigned char* workspace) const { return reinterpret_cast<T*>(workspace + offset); }
};

struct WorkspaceLayout {
  ArrayAt<DevicePage> pages;
  ArrayAt<WarpTask> warps;
  ArrayAt<BlockTask> blocks;
  ArrayAt<ExpandTask> expands;
  // What comes back: faults [num_pages, 2], and behind them the numbers of escapes.
  ArrayAt<uint32_t> faults;
  ArrayAt<uint64_t> num_escapes;  // [L4D_COMPONENT_COUNT]
  ArrayAt<HostPiece> host_pieces;
  ArrayAt<uint16_t> host_escapes;
  std::vector<ArrayAt<float>> codebooks;      // as DecodeRequest::codebooks()
  std::vector<ArrayAt<unsigned char>> parts;  // as those of DecodeRequest::reads()
  uint64_t upload_bytes = 0;                  // what the host fills; 0 where nothing is to be done
  ArrayAt<EscapeSum> escapes;
  struct ColumnsAt {
    ArrayAt<uint64_t> morton;
    ArrayAt<uint16_t> mean_t, mean_t_fine, window, opacity, scale_factor;
    ArrayAt<uint32_t> state;
    struct Component {
      ArrayAt<uint8_t> head, eob_index;
      ArrayAt<uint16_t> value;
    };
    std::array<Component, L4D_COMPONENT_COUNT> component;
  } columns;
  uint64_t bytes = 0;  // of the workspace

  static constexpr uint64_t kNumEscapesBytes = L4D_COMPONENT_COUNT * sizeof(uint64_t);
  uint64_t results_bytes() const { return num_escapes.offset - faults.offset + kNumEscapesBytes; }
};

WorkspaceLayout lay_out(const SceneHeader& header, const DecodeRequest& request,
                        const WarpSchedule& schedule, const HostPages& host);

// Pages and host pieces as kernels take them: with their places in the workspace.
std::vector<DevicePage> placed_pages(const DecodeRequest& request, const WorkspaceLayout& layout);
std::vector<HostPiece> placed_host_pieces(const SceneHeader& header, const DecodeRequest& request,
                                          const HostPages& host, const WorkspaceLayout& layout);

// The request in a workspace on the device.
DeviceRequest device_request(const SceneHeader& header, const DecodeRequest& request,
                             const WorkspaceLayout& layout, const DeviceLayer* layers,
                             unsigned char* workspace);

}  // namespace l4d::cuda
