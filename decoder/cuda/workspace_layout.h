// SPDX-License-Identifier: Apache-2.0
// Where everything of a job lies in its workspace, of which the first bytes are the upload.
#pragma once

#include <array>
#include <vector>

#include "decoder/cuda/host_pages.h"
#include "decoder/cuda/job_request.h"
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
  // What comes back: faults [num_pages, 2], and behind them the numbers of literals.
  ArrayAt<uint32_t> faults;
  ArrayAt<uint64_t> num_literals;  // [L4D_COMPONENT_COUNT]
  ArrayAt<HostPiece> host_pieces;
  ArrayAt<uint16_t> host_literals;
  std::vector<ArrayAt<float>> books;          // as JobRequest::books()
  std::vector<ArrayAt<unsigned char>> parts;  // as those of JobRequest::reads()
  uint64_t upload_bytes = 0;                  // what the host fills; 0 where nothing is to be done
  ArrayAt<LiteralSum> literals;
  struct ColumnsAt {
    ArrayAt<uint64_t> morton;
    ArrayAt<uint16_t> mean_t, mean_t_fine, opacity, scale_factor;
    ArrayAt<uint32_t> state;
    struct Component {
      ArrayAt<uint8_t> head, rung;
      ArrayAt<uint16_t> value;
    };
    std::array<Component, L4D_COMPONENT_COUNT> component;
  } columns;
  uint64_t bytes = 0;  // of the workspace

  static constexpr uint64_t kNumLiteralsBytes = L4D_COMPONENT_COUNT * sizeof(uint64_t);
  uint64_t results_bytes() const { return num_literals.offset - faults.offset + kNumLiteralsBytes; }
};

WorkspaceLayout lay_out(const SceneHeader& header, const JobRequest& request,
                        const WarpSchedule& schedule, const HostPages& host);

// Pages and host pieces as kernels take them: with their places in the workspace.
std::vector<DevicePage> placed_pages(const JobRequest& request, const WorkspaceLayout& layout);
std::vector<HostPiece> placed_host_pieces(const SceneHeader& header, const JobRequest& request,
                                          const HostPages& host, const WorkspaceLayout& layout);

// The job in a workspace on the device.
DeviceJob device_job(const JobRequest& request, const WorkspaceLayout& layout,
                     const DeviceLayer* layers, unsigned char* workspace);

}  // namespace l4d::cuda
