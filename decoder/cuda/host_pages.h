// SPDX-License-Identifier: Apache-2.0
// Pages that the host decodes, since the device has no decoder for them: rows in pinned memory, as
// wide as those of the whole request, to be copied run by run.
#pragma once

#include <array>
#include <vector>

#include "decoder/expand/page_decoder.h"
#include "decoder/read/plan.h"
#include "l4d/cuda.h"
#include "l4d/experimental/packed.h"
#include "libl4dcodec/cuda/device.h"

namespace l4d::cuda {

// L4D_CUDA_* that asks for a component.
inline uint32_t component_attribute(unsigned component) {
  if (component == L4D_COMPONENT_SH) return L4D_CUDA_SH;
  return component == L4D_COMPONENT_SCALE ? L4D_CUDA_LOG_SCALE : L4D_CUDA_ROTOR;
}

// Rows of pages of one layer that follow each other.
struct HostRun {
  uint64_t first = 0;
  uint64_t count = 0;
  uint32_t layer = 0;
  size_t first_task = 0, end_task = 0;  // in the plan
  // Packed: escapes, and where they lie among those of all runs.
  std::array<uint64_t, L4D_COMPONENT_COUNT> escape_rows{}, escape_at{};
};

class HostPages {
 public:
  HostPages(SceneFile& file, int threads) : file_(file), threads_(threads) {}

  void find(const Plan& plan);
  // attributes: L4D_CUDA_*. The charge is for what is kept.
  Status expand(const Plan& plan, uint32_t attributes, MemoryCharge* charge);
  Status pack(const Plan& plan, uint32_t attributes, MemoryCharge* charge);

  const std::vector<HostRun>& runs() const { return runs_; }
  const l4d_gaussian_buffers& expanded() const { return expanded_; }
  const l4d_packed_buffers& packed() const { return packed_; }
  const std::vector<uint16_t>& escapes() const { return escapes_; }
  // Of the rows to be copied, the more where both forms are there; without escapes.
  uint64_t bytes() const { return bytes_; }

 private:
  Status pack_run(const Plan& plan, HostRun* run, MemoryCharge* charge);

  SceneFile& file_;
  const int threads_;
  std::vector<HostRun> runs_;
  PinnedMemory expanded_memory_, packed_memory_;
  l4d_gaussian_buffers expanded_{};
  l4d_packed_buffers packed_{};
  std::vector<uint16_t> escapes_;
  uint64_t bytes_ = 0;
};

}  // namespace l4d::cuda
