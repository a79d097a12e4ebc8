// SPDX-License-Identifier: Apache-2.0
// What a request decodes: pages of a plan, and what they need besides their bytes. Nothing of where
// any of it will lie.
#pragma once

#include <array>
#include <map>
#include <tuple>
#include <vector>

#include "decoder/cuda/device_types.h"
#include "decoder/cuda/host_pages.h"
#include "decoder/cuda/layer_tables.h"
#include "decoder/read/page_reads.h"

namespace l4d::cuda {

class DecodeRequest {
 public:
  // Index of a block codebook in codebooks().
  using CodebookIndex = uint32_t;
  static constexpr CodebookIndex kLayerCodebook =
      ~CodebookIndex{0};  // the page uses that of its layer

  // The pages of `plan` that the device decodes; host pages are left to HostPages. Loads what is
  // new of the tables of their layers.
  Status make(SceneFile& file, LayerTables& tables, Plan plan, const LayerTables::Wants& wants,
              bool with_detail);
  // Where the escapes of pages are counted, those of the host's among them.
  void number_pieces(const HostPages& host);

  const Plan& plan() const { return plan_; }
  // Without places in an upload, which WorkspaceLayout gives them.
  const std::vector<DevicePage>& pages() const { return pages_; }
  const PageTask& task_of(size_t page) const { return plan_.tasks[page_tasks_[page]]; }
  // Of each page and component.
  const std::vector<std::array<CodebookIndex, L4D_COMPONENT_COUNT>>& page_codebooks() const {
    return page_codebooks_;
  }
  const std::vector<const CodebookData*>& codebooks() const { return codebooks_; }
  const std::vector<ExpandTask>& expands() const { return expands_; }
  // Of pages(), in full detail where SH is wanted so.
  const PageReads& reads() const { return reads_; }
  // Of each run of host pages, its first piece; empty where nothing may have escapes.
  const std::vector<uint32_t>& host_pieces() const { return host_pieces_; }
  uint32_t num_pieces() const { return num_pieces_; }
  uint64_t num_slots() const { return num_slots_; }
  uint64_t num_states() const { return num_states_; }
  // Whether a page of the plan, decoded on the device or not, may have escapes.
  bool may_have_escapes() const { return may_have_escapes_; }
  // Whether some of pages() is of a flat layer.
  bool has_windows() const { return has_windows_; }

 private:
  using BlockKey = std::tuple<uint32_t, uint32_t, uint32_t, unsigned>;
  Status add_page(SceneFile& file, const LayerTables::Wants& wants, size_t task, bool with_detail);
  Status add_codebooks(SceneFile& file, const LayerTables::Wants& wants, const PageTask& task,
                       DevicePage* page);

  Plan plan_;
  std::vector<size_t> page_tasks_;  // of pages_: index in the plan
  std::vector<DevicePage> pages_;
  std::vector<std::array<CodebookIndex, L4D_COMPONENT_COUNT>> page_codebooks_;
  std::vector<const CodebookData*> codebooks_;
  std::map<BlockKey, CodebookIndex> codebook_of_;
  std::vector<ExpandTask> expands_;
  PageReads reads_;
  std::vector<uint32_t> host_pieces_;
  uint32_t num_pieces_ = 0;
  uint64_t num_slots_ = 0;
  uint64_t num_states_ = 0;
  bool may_have_escapes_ = false;
  bool has_windows_ = false;
};

}  // namespace l4d::cuda
