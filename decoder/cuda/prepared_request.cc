// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/prepared_request.h"

#include <iterator>
#include <utility>

#include "l4d/cuda.h"

namespace l4d::cuda {

Status PreparedRequest::prepare(const l4d_query& query, uint32_t attributes, uint32_t forms) {
  request_ = DecodeRequest();  // what the last one held must not keep this one from being made
  file_.begin_query();
  charge_ = std::make_unique<MemoryCharge>(file_.memory());
  Plan plan;
  L4D_RETURN_IF_ERROR(make_plan(file_, query, nullptr, &plan));
  const bool expands = (forms & L4D_CUDA_FORM_EXPANDED) != 0;
  const bool packs = (forms & L4D_CUDA_FORM_PACKED) != 0;
  // A caller that keeps the indices does not request codebooks.
  LayerTables::Wants wants{};
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    wants[c] = expands && (attributes & component_attribute(c)) != 0;
  }
  const bool with_detail = (attributes & L4D_CUDA_SH) != 0 && plan.detail == L4D_DETAIL_FULL;
  L4D_RETURN_IF_ERROR(request_.make(file_, tables_, std::move(plan), wants, with_detail));
  L4D_RETURN_IF_ERROR(tables_.update());
  host_.find(request_.plan());
  if (packs) {
    L4D_RETURN_IF_ERROR(host_.pack(request_.plan(), attributes, charge_.get()));
    if (request_.may_have_escapes()) request_.number_pieces(host_);
  }
  const SceneHeader& header = file_.header();
  // Codebooks of SH need nothing of the base chunk.
  schedule_ = schedule_warps(request_.pages(), tables_.layers(), header.sh.vq(), multiprocessors_);
  layout_ = lay_out(header, request_, schedule_, host_);
  L4D_RETURN_IF_ERROR(upload_.fill(request_, schedule_, host_, layout_, charge_.get()));
  return expands ? host_.expand(request_.plan(), attributes, charge_.get()) : Status();
}

ExpandLaunch PreparedRequest::expand_launch() const {
  ExpandLaunch launch;
  launch.num_blocks = static_cast<uint32_t>(request_.expands().size());
  launch.sh_dim = file_.header().sh_dim();
  launch.sh_transform = file_.header().sh.transform();
  launch.windows = request_.has_windows();
  return launch;
}

Status PreparedRequest::check(const uint32_t* faults) const {
  struct Meaning {
    const char* clause;
    const char* message;
  };
  // By PageFault.
  static constexpr Meaning kMeanings[] = {
      {"", ""},
      {"RANS-7", "a rANS block does not end with its words and in its first state"},
      {"RANS-8", "a position is outside its range"},
      {"STRM-3", "a code is not below its limit"},
      {"VAL-1", "a coded value is not finite"},
      {"VAL-2", "a coded value is not finite"},
      {"VQ-1", "a depth is above the number of stages"},
      {"VQ-2", "an index is not below the number of codewords"},
      {"TRAN-5", "a step exponent is not below the number of step_exponents"},
      {"TRAN-6", "an EOB index is above the EOB table"},
      {"WIND-3", "a window is empty or ends after the sequence"},
  };
  for (size_t i = 0; i < 2 * num_pages(); ++i) {
    if (faults[i] == kPageOk) continue;
    if (faults[i] >= std::size(kMeanings)) {
      return Status(L4D_ERR_INTERNAL, "the device tells an unknown fault of a page");
    }
    const PageRecord& record = request_.task_of(i / 2).record;
    return corrupt(kMeanings[faults[i]].clause,
                   i % 2 == 0 ? record.chunk.offset : record.sh_detail.offset,
                   kMeanings[faults[i]].message);
  }
  return {};
}

}  // namespace l4d::cuda
