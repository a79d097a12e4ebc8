// SPDX-License-Identifier: Apache-2.0
// The bytes of a request as they go to the device, in pinned memory.
#pragma once

#include "decoder/cuda/workspace_layout.h"
#include "libl4dcodec/cuda/device.h"

namespace l4d::cuda {

class PageUpload {
 public:
  // threads: of the host.
  PageUpload(SceneFile& file, int threads) : file_(file), threads_(threads) {}

  // Fills the first layout.upload_bytes of a workspace: reads the parts of pages and checks them.
  // Fails with the first failure in the order of the pages.
  Status fill(const DecodeRequest& request, const WarpSchedule& schedule, const HostPages& host,
              const WorkspaceLayout& layout, MemoryCharge* charge);
  const void* data() const { return staging_.data(); }

 private:
  Status read_chunks(const DecodeRequest& request, const WorkspaceLayout& layout);

  SceneFile& file_;
  const int threads_;
  PinnedMemory staging_;
  Bytes read_buffer_;  // kept: fresh memory costs more than reading into it
};

}  // namespace l4d::cuda
