// SPDX-License-Identifier: Apache-2.0
// The host's half of a decode: which pages, read and checked, in pinned memory as the device takes
// them; and where everything lies in the workspace.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <tuple>
#include <vector>

#include "decoder/cuda/host_pages.h"
#include "decoder/cuda/kernels.h"
#include "decoder/cuda/layer_tables.h"
#include "libl4dcodec/cuda/device.h"

namespace l4d::cuda {

// Where the columns lie in the workspace: as Columns, in bytes from its begin.
struct ColumnOffsets {
  uint64_t morton = 0, mean_t = 0, mean_t_fine = 0, opacity = 0, scale_factor = 0, state = 0;
  struct Component {
    uint64_t head = 0, rung = 0, value = 0;
  };
  std::array<Component, L4D_COMPONENT_COUNT> component{};
};

class Job {
 public:
  // multiprocessors: of the device.
  Job(SceneFile& file, LayerTables& tables, uint32_t multiprocessors, int threads)
      : file_(file),
        tables_(tables),
        multiprocessors_(multiprocessors),
        threads_(threads),
        host_(file, threads) {}

  // attributes: L4D_CUDA_*; forms: L4D_CUDA_FORM_*.
  Status prepare(const l4d_query& query, uint32_t attributes, uint32_t forms);

  const Plan& plan() const { return plan_; }
  // All that goes to the device: what staging() holds, and rows that the host has decoded.
  uint64_t upload_bytes() const { return staging_bytes_ + host_.bytes(); }
  uint64_t staging_bytes() const { return staging_bytes_; }
  uint64_t workspace_bytes() const { return workspace_bytes_; }
  const void* staging() const { return staging_.data(); }
  // The job in a workspace on the device.
  DeviceJob device_job(unsigned char* workspace) const;
  const PlanesLaunch& planes_launch() const { return planes_launch_; }
  const ExpandLaunch& expand_launch() const { return expand_launch_; }
  // What comes back: faults [num_pages, 2], and behind them the numbers of literals.
  uint64_t faults_at() const { return faults_at_; }
  uint64_t results_bytes() const { return num_literals_at_ - faults_at_ + kNumLiteralsBytes; }
  size_t num_pages() const { return page_tasks_.size(); }
  // What faults [num_pages, 2] mean: the first one in the order of the plan.
  Status check(const uint32_t* faults) const;

  const uint64_t* num_literals(const void* results) const {
    return reinterpret_cast<const uint64_t*>(static_cast<const unsigned char*>(results) +
                                             (num_literals_at_ - faults_at_));
  }

  const HostPages& host() const { return host_; }

 private:
  struct Part {
    ChunkRef chunk;
    uint32_t page = 0;
    uint32_t part = 0;
  };
  using BlockKey = std::tuple<uint32_t, uint32_t, uint32_t, unsigned>;

  Status add_pages();
  Status add_books(const PageTask& task, DevicePage* page);
  Status lay_out();
  unsigned value_columns(unsigned c) const;
  Status fill_staging();
  Status check_part(const Part& part, ByteSpan bytes) const;
  void choose_warps();
  // Where the literals of pages are counted.
  void number_pieces();

  SceneFile& file_;
  LayerTables& tables_;
  const uint32_t multiprocessors_;
  const int threads_;  // of the host
  Plan plan_;
  LayerTables::Wants wants_{};
  bool with_detail_ = false;
  std::vector<size_t> page_tasks_;  // of those that the device decodes: index in plan
  std::vector<DevicePage> pages_;
  std::vector<WarpTask> warps_;
  std::vector<BlockTask> blocks_;
  std::vector<ExpandTask> expands_;
  std::vector<Part> parts_;
  std::vector<std::pair<const CodebookData*, uint64_t>> books_;  // and where they lie in the upload
  std::map<BlockKey, size_t> book_of_;
  static constexpr uint64_t kNumLiteralsBytes = L4D_COMPONENT_COUNT * sizeof(uint64_t);
  uint64_t warps_at_ = 0, blocks_at_ = 0, expands_at_ = 0, faults_at_ = 0, num_literals_at_ = 0;
  uint64_t host_pieces_at_ = 0, host_literals_at_ = 0, literals_at_ = 0;
  uint64_t staging_bytes_ = 0;
  uint64_t workspace_bytes_ = 0;
  ColumnOffsets columns_;
  uint64_t num_slots_ = 0;
  uint64_t num_states_ = 0;
  PlanesLaunch planes_launch_;
  ExpandLaunch expand_launch_;
  PinnedMemory staging_;
  Bytes read_buffer_;  // kept: fresh memory costs more than reading into it
  std::unique_ptr<MemoryCharge> charge_;
  HostPages host_;
  bool may_have_literals_ = false;
  std::vector<HostPiece> host_pieces_;
  uint32_t num_pieces_ = 0;
};

}  // namespace l4d::cuda
