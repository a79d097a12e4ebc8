// SPDX-License-Identifier: Apache-2.0
// The host's half of a decode: what is wanted (DecodeRequest), who decodes it (WarpSchedule), where
// it lies (WorkspaceLayout) and what goes to the device (PageUpload), put together for one query.
#pragma once

#include <memory>

#include "decoder/cuda/decode_request.h"
#include "decoder/cuda/host_pages.h"
#include "decoder/cuda/kernels.h"
#include "decoder/cuda/layer_tables.h"
#include "decoder/cuda/page_upload.h"
#include "decoder/cuda/warp_schedule.h"
#include "decoder/cuda/workspace_layout.h"

namespace l4d::cuda {

class PreparedRequest {
 public:
  // multiprocessors: of the device.
  PreparedRequest(SceneFile& file, LayerTables& tables, uint32_t multiprocessors, int threads)
      : file_(file),
        tables_(tables),
        multiprocessors_(multiprocessors),
        host_(file, threads),
        upload_(file, threads) {}

  // attributes: L4D_CUDA_*; forms: L4D_CUDA_FORM_*.
  Status prepare(const l4d_query& query, uint32_t attributes, uint32_t forms);

  const Plan& plan() const { return request_.plan(); }
  // All that goes to the device: what staging() holds, and rows that the host has decoded.
  uint64_t upload_bytes() const { return layout_.upload_bytes + host_.bytes(); }
  uint64_t staging_bytes() const { return layout_.upload_bytes; }
  uint64_t workspace_bytes() const { return layout_.bytes; }
  const void* staging() const { return upload_.data(); }
  // The request in a workspace on the device.
  DeviceRequest device_request(unsigned char* workspace) const {
    return cuda::device_request(file_.header(), request_, layout_, tables_.device_layers(),
                                workspace);
  }
  const ChannelsLaunch& channels_launch() const { return schedule_.launch; }
  ExpandLaunch expand_launch() const;
  // What comes back: faults [num_pages, 2], and behind them the numbers of escapes.
  uint64_t faults_at() const { return layout_.faults.offset; }
  uint64_t results_bytes() const { return layout_.results_bytes(); }
  size_t num_pages() const { return request_.pages().size(); }
  // What faults [num_pages, 2] mean: the first one in the order of the plan.
  Status check(const uint32_t* faults) const;

  const uint64_t* num_escapes(const void* results) const {
    return reinterpret_cast<const uint64_t*>(static_cast<const unsigned char*>(results) +
                                             (layout_.num_escapes.offset - layout_.faults.offset));
  }

  const HostPages& host() const { return host_; }

 private:
  SceneFile& file_;
  LayerTables& tables_;
  const uint32_t multiprocessors_;
  std::unique_ptr<MemoryCharge> charge_;
  DecodeRequest request_;
  WarpSchedule schedule_;
  WorkspaceLayout layout_;
  HostPages host_;
  PageUpload upload_;
};

}  // namespace l4d::cuda
